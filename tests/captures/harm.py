"""Damages of files at random: truncated, removed, resized, exchanged, emptied, pointing outside."""

from __future__ import annotations

import json
import shutil
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

Rng = np.random.Generator
# A damage changes what lies at the place and says what it did; options of the command go with it.
Damage = Callable[[Path, Rng], str | tuple[str, list[str]]]


def pick(rng: Rng, place: Path, *patterns: str) -> Path:
    """One of the files that match."""
    paths = sorted(path for pattern in patterns for path in place.glob(pattern) if path.is_file())
    return paths[int(rng.integers(len(paths)))]


def truncated(*patterns: str) -> Damage:
    def damage(place: Path, rng: Rng) -> str:
        path = pick(rng, place, *patterns)
        size = path.stat().st_size
        kept = 0 if rng.uniform() < 0.1 else int(rng.integers(size))
        path.write_bytes(path.read_bytes()[:kept])
        return f"{path.name} truncated to {kept} of {size} bytes"

    return damage


def removed(*patterns: str) -> Damage:
    def damage(place: Path, rng: Rng) -> str:
        path = pick(rng, place, *patterns)
        path.unlink()
        return f"{path.name} removed"

    return damage


def resized(*patterns: str) -> Damage:
    def damage(place: Path, rng: Rng) -> str:
        path = pick(rng, place, *patterns)
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        size = tuple(int(n) for n in rng.integers(1, 2 * max(image.shape), 2))
        cv2.imwrite(str(path), cv2.resize(image, size, interpolation=cv2.INTER_NEAREST))
        return f"{path.name} resized to {size}"

    return damage


def dark(*patterns: str) -> Damage:
    def damage(place: Path, rng: Rng) -> str:
        path = pick(rng, place, *patterns)
        cv2.imwrite(str(path), 0 * cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
        return f"{path.name} zero everywhere"

    return damage


def exchanged(*patterns: str) -> Damage:
    """An image of the other kind in the place of one: colour as depth, or depth as colour."""

    def damage(place: Path, rng: Rng) -> str:
        target = pick(rng, place, *patterns)
        other = "depth" if target.parent.name != "depth" else patterns[0].split("/")[-2]
        shutil.copyfile(pick(rng, target.parents[1], f"{other}/*"), target)
        return f"{target.parent.name}/{target.name} is an image of {other}"

    return damage


def flipped(*patterns: str) -> Damage:
    """A bit of a file whose checksum tells."""

    def damage(place: Path, rng: Rng) -> str:
        path = pick(rng, place, *patterns)
        data = bytearray(path.read_bytes())
        at = int(rng.integers(len(data)))
        data[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(bytes(data))
        return f"{path.name}: a bit of byte {at} flipped"

    return damage


def linked_outside(*patterns: str) -> Damage:
    """What an archive can hold: a link to a file beside the recording."""

    def damage(place: Path, rng: Rng) -> str:
        path = pick(rng, place, *patterns)
        secret = place.parent / f"secret{path.suffix}"
        shutil.move(path, secret)
        path.symlink_to(secret)
        return f"{path.name} is a link to a file outside"

    return damage


def swapped_lines(pattern: str) -> Damage:
    def damage(place: Path, rng: Rng) -> str:
        path = pick(rng, place, pattern)
        lines = path.read_text().splitlines()
        rows = [row for row, text in enumerate(lines) if row and not text.startswith("#")]
        one = int(rng.integers(len(rows) - 1))
        lines[rows[one]], lines[rows[one + 1]] = lines[rows[one + 1]], lines[rows[one]]
        path.write_text("\n".join(lines) + "\n")
        return f"{path.name}: rows {one} and {one + 1} change places"

    return damage


def rewritten(pattern: str, column: int, values: list[str], separator: str = ",") -> Damage:
    """A cell of a table replaced by one of the values."""

    def damage(place: Path, rng: Rng) -> str:
        path = pick(rng, place, pattern)
        lines = path.read_text().splitlines()
        rows = [row for row, text in enumerate(lines) if row and not text.startswith("#")]
        row = rows[int(rng.integers(len(rows)))]
        cells = lines[row].split(separator)
        cells[column] = values[int(rng.integers(len(values)))].replace("PLACE", str(place.parent))
        lines[row] = separator.join(cells)
        (place.parent / "secret.png").write_bytes(next(place.glob("**/depth/*.png")).read_bytes())
        path.write_text("\n".join(lines) + "\n")
        return f"{path.name}: line {row + 1} says {cells[column]!r}"

    return damage


def without_key(name: str, *keys: str) -> Damage:
    """A key of a JSON gone, null, zero or text."""

    def damage(place: Path, rng: Rng) -> str:
        path = place / name
        data = json.loads(path.read_text())
        key = keys[int(rng.integers(len(keys)))]
        parts = key.split(".")
        inner = data
        for part in parts[:-1]:
            inner = inner[part]
        how = int(rng.integers(4))
        if how == 0:
            del inner[parts[-1]]
        else:
            inner[parts[-1]] = (None, 0, "soon")[how - 1]
        path.write_text(json.dumps(data))
        return f"{path.name}: {key} is {('gone', 'null', '0', 'text')[how]}"

    return damage


def no_such_topic(place: Path, rng: Rng) -> tuple[str, list[str]]:
    role = ("color", "depth", "camera_info", "camera_pose", "motion")[int(rng.integers(5))]
    name = ("/nowhere", "/camera", "/tf:nothing", "")[int(rng.integers(4))]
    return f"--topic {role}={name}", ["--topic", f"{role}={name}"]


def bag_metadata(place: Path, rng: Rng) -> str:
    """metadata.yaml that points at a file outside."""
    path = place / "source/metadata.yaml"
    stored = next(p for p in (place / "source").iterdir() if p.suffix != ".yaml")
    outside = place.parent / f"secret{stored.suffix}"
    shutil.move(stored, outside)
    to = (f"../../{outside.name}", str(outside))[int(rng.integers(2))]
    path.write_text(path.read_text().replace(stored.name, to))
    return f"metadata.yaml names {to if to.startswith('.') else 'an absolute path'} outside"


def enormous(*patterns: str) -> Damage:
    """A PNG whose header, checksum and all, asks for gigabytes."""

    def damage(place: Path, rng: Rng) -> str:
        path = pick(rng, place, *patterns)
        data = bytearray(path.read_bytes())
        sizes = [int(n) for n in rng.integers(30_000, 2**31, 2)]
        data[16:24] = struct.pack(">II", *sizes)
        data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
        path.write_bytes(bytes(data))
        return f"{path.name} says {sizes[0]} x {sizes[1]} pixels"

    return damage


def outside_key(name: str, *keys: str) -> Damage:
    """A path in a JSON that leads out of the folder."""

    def damage(place: Path, rng: Rng) -> str:
        path, key = place / name, keys[int(rng.integers(len(keys)))]
        (place.parent / "secret.png").write_bytes(next(place.glob("**/depth/*.png")).read_bytes())
        to = ("../../secret.png", str(place.parent / "secret.png"), "/etc/hostname")[int(rng.integers(3))]
        path.write_text(json.dumps(json.loads(path.read_text()) | {key: to}))
        return f"{path.name}: {key} leads outside"

    return damage
