"""From depth images to an ordered chain on the rope's axis: Algorithm 1 of the paper."""

from dlolib.chain.extract import ChainResult, FrameChain, chain_frame, extract_chain
from dlolib.chain.settings import ChainSettings
from dlolib.chain.sheet import chain_on_image, write_sheet

__all__ = [
    "ChainResult",
    "ChainSettings",
    "FrameChain",
    "chain_frame",
    "chain_on_image",
    "extract_chain",
    "write_sheet",
]
