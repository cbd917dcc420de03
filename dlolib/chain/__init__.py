"""From depth images to an ordered chain on the rope's axis: Algorithm 1 of the paper."""

from dlolib.chain.extract import ChainResult, extract_chain
from dlolib.chain.frame import FrameChain, chain_frame
from dlolib.chain.settings import ChainSettings
from dlolib.chain.sheet import chain_on_image, write_sheet
from dlolib.chain.tracker import Tracker

__all__ = [
    "ChainResult",
    "ChainSettings",
    "FrameChain",
    "Tracker",
    "chain_frame",
    "chain_on_image",
    "extract_chain",
    "write_sheet",
]
