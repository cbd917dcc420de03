"""The one door to rosbags: ROS 1 bags, ROS 2 bags and MCAP, read without ROS."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from dlolib.errors import FormatError

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

STORED = (".bag", ".mcap", ".db3")
# Of SQLite's header: the page's size; later the file's change counter, its pages, and the counter that those
# pages are valid for.
SQLITE, COUNTED = struct.Struct(">16xH"), struct.Struct(">24xII60xI")

# librealsense writes so much behind an image that is no part of it.
TAIL = bytes(4)


@dataclass
class Bag:
    """A recording by topics; a context, since it holds files open."""

    path: Path
    _reader: AnyReader | None = None
    _stack: ExitStack = field(default_factory=ExitStack)

    def __enter__(self) -> Self:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        for path in sorted(self.path.glob("*.db3")) if self.path.is_dir() else [self.path]:
            _check_pages(path)
        with self._readable("the bag"):
            # bags of older ROS 2 do not say what their messages look like
            reader = AnyReader([self.path], default_typestore=get_typestore(Stores.LATEST))
            self._reader = self._stack.enter_context(reader)
        return self

    def __exit__(self, *raised: object) -> None:
        self._stack.close()

    @property
    def types(self) -> dict[str, str]:
        """The type of each topic, such as sensor_msgs/msg/Image."""
        assert self._reader is not None
        return {connection.topic: connection.msgtype for connection in self._reader.connections}

    def count(self, topic: str) -> int:
        """How many messages of a topic the bag promises."""
        assert self._reader is not None
        return sum(one.msgcount for one in self._reader.connections if one.topic == topic)

    def messages(self, topics: Sequence[str]) -> Iterator[tuple[str, int, int, Any]]:
        """Topic, number within the topic, time of logging [ns] and content of each message, in logged order.

        Raises:
            FormatError: damaged, or fewer messages than the bag promises.
        """
        reader = self._reader
        assert reader is not None
        chosen = [connection for connection in reader.connections if connection.topic in topics]
        counts = dict.fromkeys(topics, 0)
        # rosbags takes no choice for all
        rows = reader.messages(chosen) if chosen else iter(())
        while True:
            with self._readable(", ".join(topics)):
                row = next(rows, None)
            if row is None:
                break
            connection, logged_ns, raw = row
            with self._readable(f"{connection.topic}, message {counts[connection.topic]}"):
                message = _parsed(reader, raw, connection.msgtype)
            yield connection.topic, counts[connection.topic], logged_ns, message
            counts[connection.topic] += 1
        for topic in topics:
            promised = self.count(topic)
            if counts[topic] != promised:
                problem = f"is truncated: {counts[topic]} messages where it promises {promised}"
                raise FormatError(problem, file=self.path, place=topic, mend="record or copy it again")

    def first(self, topic: str) -> Any:
        """The first message of a topic.

        Raises:
            FormatError: there is none.
        """
        for _, _, _, message in self.messages([topic]):
            return message
        raise FormatError("has no message", file=self.path, place=topic, mend="name another topic")

    @contextmanager
    def _readable(self, place: str) -> Iterator[None]:
        """Whatever damaged bytes make of the parsers (any error at all) becomes one line."""
        try:
            yield
        except Exception as error:
            problem = f"cannot be read: {str(error)[:120].rstrip('.') or type(error).__name__}"
            mend = "record or copy it again, or mend it (rosbag reindex, mcap recover)"
            raise FormatError(problem, file=self.path, place=place, mend=mend) from error


def _parsed(reader: AnyReader, raw: bytes, kind: str) -> Any:
    from rosbags.highlevel import AnyReaderError

    try:
        return reader.deserialize(raw, kind)
    except AnyReaderError:
        if not raw.endswith(TAIL):
            raise
        return reader.deserialize(raw[: -len(TAIL)], kind)


def _check_pages(path: Path) -> None:
    """Refuse an SQLite file shorter than it says: SQLite does not look at pages that no question leads to."""
    if path.suffix != ".db3":
        return
    with path.open("rb") as file:
        head = file.read(COUNTED.size)
    if len(head) == COUNTED.size:
        (page,) = SQLITE.unpack_from(head)
        counter, pages, valid_for = COUNTED.unpack(head)
        size = 65536 if page == 1 else page
        if counter != valid_for or path.stat().st_size >= size * pages:
            return
    place = f"byte {path.stat().st_size}"
    raise FormatError("is truncated", file=path, place=place, mend="record or copy it again")


def stamp_s(message: Any, logged_ns: int) -> float:
    """When a message was taken [s]: its own stamp, or the time of logging where it has none."""
    stamp = message.header.stamp
    return ((stamp.sec * 10**9 + stamp.nanosec) or logged_ns) / 10**9
