"""How does a run survive being killed? Kept states in an append-only file, checkpoints put in place at once.

Rule: `frames.bin` holds a header and one frame for each kept state, each with its length and CRC; what a killed process or
a full disk left unfinished at the end counts for nothing. `checkpoint.npz` holds all that the rest of the run depends on;
it is written under another name and put in place, so it is always a whole one. A run goes on from the checkpoint: frames
written after it are dropped and come again, bit for bit.
"""

from __future__ import annotations

import io
import json
import os
import pathlib
import struct
import zlib
from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

import numpy as np

from .errors import SceneError
from .export import replace_file
from .model import Model
from .motion.integrator import Checkpoint
from .record import Record
from .space import Contact, State, Touch
from .terms.inertial import Rates
from .terms.touch import Pressed

FRAMES, CHECKPOINT = "frames.bin", "checkpoint.npz"
TOLD_ARRAYS = ("load", "spans", "nodes", "force")  # of what a contact term does
TOLD = tuple(entry.name for entry in fields(Pressed) if entry.name not in TOLD_ARRAYS)  # numbers and words
MAGIC = b"cosserat_fem frames 1\n"
HEAD = struct.Struct("<QI")


def pack(about: dict[str, Any], arrays: dict[str, np.ndarray]) -> bytes:
    """Numbers and arrays as the bytes of an NPZ file."""
    out = io.BytesIO()
    named: dict[str, Any] = {"about": np.frombuffer(json.dumps(about).encode(), dtype=np.uint8), **arrays}
    np.savez(out, **named)
    return out.getvalue()


def unpack(data: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Undo `pack`."""
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    return json.loads(arrays.pop("about").tobytes()), arrays


class FrameFile:
    """The frames of one run, open for appending."""

    def __init__(self, path: pathlib.Path, scene: str, keep: int | None = None) -> None:
        """scene: what identifies the scene. keep: go on after this many frames; None starts a new file."""
        if keep is None:
            path.write_bytes(b"")
        else:
            os.truncate(path, _end_of(path, keep))
        self._file = open(path, "ab")  # noqa: SIM115  open as long as the run lasts
        if keep is None:
            self._append(json.dumps({"scene": scene}).encode(), MAGIC)

    def _append(self, data: bytes, before: bytes = b"") -> None:
        self._file.write(before + HEAD.pack(len(data), zlib.crc32(data)) + data)
        self._file.flush()

    def append(self, record: Record) -> None:
        """Add one kept state."""
        state, rates = record.state, record.rates
        if rates is None:
            raise ValueError("frames: only states of a run in time can be kept.")
        about: dict[str, Any] = {
            "t": state.t,
            "iterations": record.iterations,
            "residual": record.residual,
            "work": record.work,
        }
        arrays = {"r": state.r, "q": state.q, "reactions": record.reactions, "v": rates.v, "a": rates.a, "b": rates.b}
        if record.contact:
            about["contact"] = [{name: getattr(told, name) for name in TOLD} for told in record.contact]
            arrays |= {f"{name}_{k}": getattr(p, name) for k, p in enumerate(record.contact) for name in TOLD_ARRAYS}
        self._append(pack(about, arrays))

    def sync(self) -> None:
        """Wait until everything is on the disk."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        self._file.close()


def _chunks(path: pathlib.Path) -> Iterator[tuple[int, bytes]]:
    """End and content of each whole chunk: the header, then the frames."""
    with open(path, "rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise SceneError(f"{path}: is not a file of frames.")
        while len(head := file.read(HEAD.size)) == HEAD.size:
            size, crc = HEAD.unpack(head)
            data = file.read(size)
            if len(data) < size or zlib.crc32(data) != crc:
                return
            yield file.tell(), data


def _end_of(path: pathlib.Path, keep: int) -> int:
    ends = [end for end, _ in _chunks(path)]
    if len(ends) <= keep:
        raise SceneError(f"{path}: holds {max(len(ends) - 1, 0)} states, but the checkpoint counts on {keep}.")
    return ends[keep]


def read_frames(path: pathlib.Path, keep: int | None = None) -> tuple[str, list[Record]]:
    """What identifies the scene, and the records of all whole frames, or of the first `keep`."""
    chunks = _chunks(path)
    try:
        scene = json.loads(next(chunks)[1])["scene"]
    except StopIteration:
        raise SceneError(f"{path}: holds no whole frame.") from None
    records: list[Record] = []
    for _, data in chunks:
        if keep is not None and len(records) == keep:
            break
        about, arrays = unpack(data)
        state = State(about["t"], arrays["r"], arrays["q"], ())
        rates = Rates(arrays["v"], arrays["a"], arrays["b"])
        contact = tuple(
            Pressed(**(told | {name: arrays[f"{name}_{k}"] for name in TOLD_ARRAYS}))
            for k, told in enumerate(about.get("contact", ()))
        )
        found = (arrays["reactions"], about["iterations"], about["residual"], -1, rates, about["work"], contact)
        records.append(Record(state, *found))
    return scene, records


LISTS = ("stress", "forces", "strain", "strain_before")


def write_checkpoint(path: pathlib.Path, scene: str, saved: Checkpoint, counters: dict[str, Any]) -> None:
    """Put a checkpoint in place of the last one."""
    about = {
        "scene": scene,
        "t": saved.state.t,
        "h": saved.h,
        "wanted_h": saved.wanted_h,
        "work": saved.work,
        "strain_step": saved.strain_step,
        "kept": saved.kept,
        "largest_energy": saved.largest_energy,
        "added": saved.added,
        "counters": counters,
        "lists": {name: len(_list(saved, name)) for name in LISTS},
    }
    arrays = {"r": saved.state.r, "q": saved.state.q, "v": saved.rates.v, "a": saved.rates.a, "b": saved.rates.b}
    arrays |= {"residual": saved.residual, "log": np.array(saved.log, dtype=float).reshape(-1, 4)}
    arrays |= {f"{name}_{k}": array for name in LISTS for k, array in enumerate(_list(saved, name))}
    contact = saved.state.contact
    if contact is not None:  # the terms in the order of the model
        about["contact"] = {"time": contact.time, "base_time": contact.base_time}
        about["touch"] = [{"scale": touch.scale, "lost": touch.lost} for touch in contact.touch.values()]
        arrays |= {"base_r": contact.base_r, "base_q": contact.base_q}
        for k, touch in enumerate(contact.touch.values()):
            arrays |= {f"keys_{k}": touch.keys, f"slips_{k}": touch.slips, f"forces_{k}": touch.forces}
    if saved.lasts is not None:
        arrays["lasts"] = saved.lasts
    data = pack(about, arrays)

    def write(temporary: pathlib.Path) -> None:
        with open(temporary, "wb") as file:
            file.write(HEAD.pack(len(data), zlib.crc32(data)) + data)
            file.flush()
            os.fsync(file.fileno())

    replace_file(path, write)


def _list(saved: Checkpoint, name: str) -> Any:
    return saved.state.stress if name == "stress" else getattr(saved, name)


def _restored(about: dict[str, Any], arrays: dict[str, np.ndarray]) -> tuple[dict[str, Any], Checkpoint]:
    """What was said beside a checkpoint, and the checkpoint. KeyError for what it does not have."""
    lists = {name: tuple(arrays[f"{name}_{k}"] for k in range(n)) for name, n in about["lists"].items()}
    saved = Checkpoint(
        State(about["t"], arrays["r"], arrays["q"], lists["stress"], contact=_contact(about, arrays)),
        Rates(arrays["v"], arrays["a"], arrays["b"]),
        about["h"],
        about["wanted_h"],
        about["work"],
        list(lists["forces"]),
        arrays["residual"],
        lists["strain"],
        lists["strain_before"],
        about["strain_step"],
        about["kept"],
        about["largest_energy"],
        about["added"],
        arrays.get("lasts"),
        [(t, h, error, bool(accepted)) for t, h, error, accepted in arrays["log"].tolist()],
    )
    return about, saved


def _contact(about: dict[str, Any], arrays: dict[str, np.ndarray]) -> Contact | None:
    """Memory of contact, its terms by their numbers."""
    if "contact" not in about:
        return None
    touch = {
        k: Touch(arrays[f"keys_{k}"], arrays[f"slips_{k}"], arrays[f"forces_{k}"], **said)
        for k, said in enumerate(about["touch"])
    }
    return Contact(**about["contact"], base_r=arrays["base_r"], base_q=arrays["base_q"], touch=touch)


def with_terms(saved: Checkpoint, model: Model) -> Checkpoint:
    """A checkpoint that was read, with the contact terms of its model instead of their numbers."""
    contact = saved.state.contact
    if contact is None:
        return saved
    touch = dict(zip(model.contacts, contact.touch.values(), strict=True))
    return replace(saved, state=replace(saved.state, contact=replace(contact, touch=touch)))


def read_checkpoint(path: pathlib.Path) -> tuple[str, Checkpoint, dict[str, Any]]:
    """What identifies the scene, the checkpoint (see `with_terms`), and the counters until then. SceneError if there is
    none."""
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise SceneError(f"{path.parent}: has no checkpoint to go on from; start it with `cosserat-fem run`.") from None
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}.") from None
    data = content[HEAD.size :]
    if len(content) < HEAD.size or HEAD.unpack(content[: HEAD.size]) != (len(data), zlib.crc32(data)):
        raise SceneError(f"{path}: is not a whole checkpoint; start again with `cosserat-fem run`.")
    try:
        about, saved = _restored(*unpack(data))
    except KeyError as missing:
        raise SceneError(
            f"{path}: was written by another version of cosserat_fem (it has no {missing}); start again with "
            "`cosserat-fem run`."
        ) from None
    return about["scene"], saved, about["counters"]
