"""The files at the border: read strictly, written whole, refused in one line."""

from dlolib.formats._json import read_object
from dlolib.formats.capture import read_capture_index, write_capture_index, write_capture_json
from dlolib.formats.doubts import motion_doubts, moves, say
from dlolib.formats.fit import read_fit, write_fit
from dlolib.formats.geometry import nearest_distance, signed_distance
from dlolib.formats.given import Given, read_given, read_given_motion
from dlolib.formats.layout import LEARNED_FOR, read_layout, write_layout
from dlolib.formats.motion import interpolate_motion, read_motion, write_motion
from dlolib.formats.recording import read_recording, write_recording
from dlolib.formats.verdict import read_verdict, write_verdict

__all__ = [
    "LEARNED_FOR",
    "Given",
    "interpolate_motion",
    "motion_doubts",
    "moves",
    "nearest_distance",
    "read_capture_index",
    "read_fit",
    "read_given",
    "read_given_motion",
    "read_layout",
    "read_motion",
    "read_object",
    "read_recording",
    "read_verdict",
    "say",
    "signed_distance",
    "write_capture_index",
    "write_capture_json",
    "write_fit",
    "write_layout",
    "write_motion",
    "write_recording",
    "write_verdict",
]
