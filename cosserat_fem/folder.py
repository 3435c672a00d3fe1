"""Whose files are these? The folder of a run, held while the run lasts.

Rule: only files that a run made are deleted or replaced. They are known by their names in a folder whose `summary.json` is
ours; everything else is the user's and stays, also in `pictures` and `pvd`. A run holds its folder by the file `.running`
with the number of its process, so that two runs never mix their files; a file left by a process that is gone counts for
nothing.
"""

from __future__ import annotations

import json
import os
import pathlib
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field

from .cables.band import FOLDER as STICK
from .errors import SceneError
from .export import UNITS

PROGRAM = "cosserat_fem"
RESULTS = ("reactions.csv", "hinge_torque.csv", "history.vtkhdf", "parts.vtkhdf")
TOUCHING = ("contacts.csv", "contact_loads.csv")  # of a scene with contact
DRIVEN = ("joint_model.json", "drive.csv")  # of hinges that turn both ways or have a drive
IN_TIME = ("ledger.csv", "steps.csv", "frames.bin", "checkpoint.npz")  # of a run in time
CHECKED = ("checks.csv", "margins.npz")  # of a scene with checks
ALONG = ("path.csv", "modes.csv", "modes.vtkhdf")  # of a path; of vibrations
FILES = (
    "scene.toml", *RESULTS, *TOUCHING, *DRIVEN, *IN_TIME, *CHECKED, *ALONG, "history.pvd", "report.html", "summary.json"
)  # fmt: skip
LOCK = ".running"
# names that we give in each folder; pictures of one state are called after the field that colours them
_NAMES = {
    "": "|".join(re.escape(name) for name in FILES),
    "pictures": r"(reactions|hinge_torque|drive|ledger|path|margins|margin_map)\.(png|svg)|(stages|moment)\.png"
    r"|film\.(mp4|webp)"
    rf"|({'|'.join(['shape', *UNITS])})_(last|-?\d+)\.png",
    "pvd": r"(rods|parts)_\d{5,}\.vtu",
}
# the same again in the folder of the run with sticking strands
NAMES = _NAMES | {f"{STICK}/{name}".rstrip("/"): names for name, names in _NAMES.items()}


@dataclass
class Contents:
    """What a folder holds: files with names of ours, things that stand where our files go, and all else."""

    named: list[pathlib.Path] = field(default_factory=list)
    blocking: list[pathlib.Path] = field(default_factory=list)
    others: list[pathlib.Path] = field(default_factory=list)


def contents(folder: pathlib.Path) -> Contents:
    """Sort what is in a run folder and in those folders in it that a run makes, without the lock of a run."""
    found = Contents()
    _sort_all(folder, "", found)
    return found


def _sort_all(folder: pathlib.Path, inside: str, found: Contents) -> None:
    for entry in sorted(folder.iterdir()):
        name = f"{inside}/{entry.name}".lstrip("/")
        if not inside and entry.name == LOCK and _holder(entry) is not None:
            continue
        if name not in NAMES:
            _sort(entry, inside, found)
        elif entry.is_symlink() or not entry.is_dir():
            found.blocking.append(entry)
        else:
            _sort_all(entry, name, found)


def _sort(entry: pathlib.Path, inside: str, found: Contents) -> None:
    temporary = re.fullmatch(r"\.(.+)-[a-z0-9_]{8}(\.\w+)", entry.name)  # see `replace_file`
    name = "".join(temporary.groups()) if temporary else entry.name
    if name != LOCK and not re.fullmatch(NAMES[inside], name):
        found.others.append(entry)
    elif entry.is_symlink() or not entry.is_file() or name == LOCK:
        found.blocking.append(entry)
    else:
        found.named.append(entry)


class RunFolder:
    """The folder of one run: made or cleared of an earlier run on entering, held until leaving.

    Parameters
    ----------
    path : folder
    inputs : files that the run reads; none of them may be replaced
    force : bool
        Also use a folder that holds other files; they stay.
    resume : bool
        Hold the folder of an earlier run and leave everything in it.

    Raises
    ------
    SceneError
        On entering: the folder cannot be used, or another run holds it.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        inputs: Iterable[pathlib.Path] = (),
        *,
        force: bool = False,
        resume: bool = False,
    ) -> None:
        self.path, self.inputs, self.force, self.resume = pathlib.Path(path), tuple(inputs), force, resume
        self._where = f"output folder {str(self.path)!r}"

    def __enter__(self) -> RunFolder:
        if self.resume:
            if not _is_ours(self.path):
                raise SceneError(f"{self.path}: is not the folder of a run.")
            try:
                self._hold()
            except OSError as error:
                raise SceneError(f"{self.path}: cannot be written: {error.strerror}.") from None
            return self
        try:
            self._check()
            self.path.mkdir(parents=True, exist_ok=True)
            self._hold()
        except OSError as error:
            raise SceneError(f"{self._where}: cannot be written: {error.strerror}. Choose another with -o.") from None
        try:
            self._clear(self._check())
        except BaseException as error:
            self._release()
            if isinstance(error, OSError):
                raise SceneError(
                    f"{self._where}: cannot be cleared: {error.strerror}. Choose another with -o."
                ) from None
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._release()

    def _check(self) -> list[pathlib.Path]:
        """Files of an earlier run. SceneError if the folder holds what must stay."""
        if not self.path.exists():
            return []
        if not self.path.is_dir():
            raise SceneError(f"{self._where}: is a file. Choose another with -o.")
        pid = _holder(self.path / LOCK)
        if pid is not None and pid != os.getpid() and _lives(pid):
            raise SceneError(self._held_by(pid))
        found, ours = contents(self.path), _is_ours(self.path)
        for file in self.inputs:
            for taken in [*found.named, *found.blocking]:
                if taken.exists() and file.exists() and taken.samefile(file):
                    raise SceneError(
                        f"{self._where}: the run reads {self._name(taken)!r} there and would replace it. "
                        "Choose another with -o."
                    )
        foreign = found.blocking if ours else [*found.named, *found.blocking]
        strangers = sorted([*foreign, *found.others])
        beside = "beside an earlier run" if ours else "and is not an earlier run of this program"
        if strangers and not self.force:
            hint = "" if foreign else ", or use --force to write into it; its other files stay"
            raise SceneError(
                f"{self._where}: holds {self._name(strangers[0])!r} {beside}. Choose another with -o{hint}."
            )
        if foreign:
            raise SceneError(
                f"{self._where}: holds {self._name(foreign[0])!r} {beside}; a run would replace it. Choose another "
                "with -o, or move it away."
            )
        return found.named

    def _name(self, path: pathlib.Path) -> str:
        return path.relative_to(self.path).as_posix()

    def _clear(self, files: list[pathlib.Path]) -> None:
        # the summary goes last: with it gone the folder is not ours any more
        for file in sorted(files, key=lambda file: file.name == "summary.json"):
            file.unlink(missing_ok=True)
        for name in sorted(filter(None, NAMES), reverse=True):  # inner ones first
            folder = self.path / name
            if folder.is_dir() and not any(folder.iterdir()):
                folder.rmdir()

    def _hold(self) -> None:
        """Make the lock. SceneError if a living process has it."""
        lock = self.path / LOCK
        for _ in range(10):
            try:
                handle = os.open(lock, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644)
            except FileExistsError:
                self._drop_stale(lock)
                continue
            try:
                os.write(handle, f"{os.getpid()}\n".encode())
            except OSError:
                lock.unlink(missing_ok=True)
                raise
            finally:
                os.close(handle)
            return
        raise SceneError(self._held_by(None))

    def _drop_stale(self, lock: pathlib.Path) -> None:
        """Remove a lock whose process is gone; SceneError if it lives."""
        pid = _holder(lock)
        if pid is None or _lives(pid):
            raise SceneError(self._held_by(pid))
        # taken aside first: another process may have put its own lock here since it was read
        aside = lock.with_name(f"{LOCK}-{os.getpid()}")
        try:
            os.rename(lock, aside)
        except FileNotFoundError:
            return
        if _holder(aside) != pid:
            os.rename(aside, lock)
            raise SceneError(self._held_by(None))
        aside.unlink()

    def _held_by(self, pid: int | None) -> str:
        who = "" if pid is None else f" (process {pid})"
        return (
            f"{self._where}: another run{who} is writing into it. Wait for it, or choose another with -o. "
            f"If there is no such run, delete its file {LOCK}."
        )

    def _release(self) -> None:
        lock = self.path / LOCK
        if _holder(lock) == os.getpid():
            with suppress(OSError):
                lock.unlink()


def check_study(path: pathlib.Path, about: str, ours: Iterable[str]) -> None:
    """SceneError if a folder holds what is not of a study whose own file is `about` and whose other names are `ours`."""
    if not path.exists():
        return
    where = f"output folder {str(path)!r}"
    if not path.is_dir():
        raise SceneError(f"{where}: is a file. Choose another with -o.")
    held = sorted(entry.name for entry in path.iterdir())
    strangers = [name for name in held if name not in (about, LOCK, *ours)]
    if strangers or (held and not _is_ours(path, about)):
        raise SceneError(
            f"{where}: holds {[*strangers, *held][0]!r} and is not that of an earlier such study alone. Choose another "
            "with -o."
        )


@contextmanager
def hold(path: pathlib.Path) -> Iterator[None]:
    """Hold a folder as a run does, whatever is in it. SceneError if a living process has it."""
    folder = RunFolder(path)
    folder._hold()
    try:
        yield
    finally:
        folder._release()


def _is_ours(folder: pathlib.Path, about: str = "summary.json") -> bool:
    try:
        return json.loads((folder / about).read_text(encoding="utf-8")).get("program") == PROGRAM
    except (OSError, ValueError, AttributeError, RecursionError):
        return False


def _holder(lock: pathlib.Path) -> int | None:
    """Process number in a lock; None if it holds none (yet)."""
    try:
        text = lock.read_text(encoding="ascii")
    except (OSError, ValueError):
        return None
    return int(text) if re.fullmatch(r"[1-9]\d{0,9}\n", text) else None


def _lives(pid: int) -> bool:
    if os.name != "posix":  # there is no harmless signal elsewhere
        return True
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # another user's
        return True
    return True
