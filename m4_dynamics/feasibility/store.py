"""Results of a sweep on disk as they come: a Zarr store in which a record is either there whole or not at all.

The record of a rollout is one chunk, and a chunk appears by renaming a file. A run that is killed therefore loses only
the rollouts that were under way, and a run that resumes does nothing twice.
"""

from __future__ import annotations

import hashlib
import json
import math
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from m4_dynamics.errors import ResultFileError
from m4_dynamics.feasibility.job import Place, SweepJob

__all__ = ["SweepStore", "create_store", "open_store"]

_Array = NDArray[np.float64]

_IDENTITY = "identity"


@dataclass(frozen=True, slots=True, eq=False)
class SweepStore:
    """An open store.

    Attributes:
        path: Its folder.
        kind: Of the map, see `SweepJob.kind`.
        identity: Robot, version, axes and settings that all its records share.
        records: The array of records on disk; its dimensions are the axes, the last one the fields.
    """

    path: Path
    kind: str
    identity: Mapping[str, Any]
    records: Any

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values on each axis."""
        return tuple(int(n) for n in self.records.shape[:-1])

    @property
    def size(self) -> int:
        """Number of places."""
        return math.prod(self.shape)

    @property
    def fingerprint(self) -> str:
        """Sha256 of kind and identity: what is made from this store can say so, and is not taken for another's."""
        text = json.dumps([self.kind, self.identity], sort_keys=True)
        return hashlib.sha256(text.encode("utf-8")).hexdigest()

    def read(self) -> _Array:
        """All records; NaN where there is none.

        Raises:
            ResultFileError: A record cannot be read.
        """
        try:
            return np.asarray(self.records[...], dtype=float)
        except (OSError, ValueError) as error:
            raise ResultFileError(f"cannot read {self.path}: {error}") from error

    def missing(self) -> list[Place]:
        """Places without a record, in the order of the axes."""
        return [tuple(int(i) for i in index) for index in np.argwhere(np.isnan(self.read()[..., 0]))]

    def write(self, index: Place, record: _Array) -> None:
        """Add one record.

        Args:
            index: Its place.
            record: Shape (fields,); the first is not NaN.

        Raises:
            ResultFileError: It cannot be written; what was there before still is.
        """
        try:
            self.records[tuple(index)] = record
        except OSError as error:
            raise ResultFileError(
                f"cannot write to {self.path}: {error.strerror or error}; what is done is kept, go on with --resume"
            ) from error


def create_store(path: Path, job: SweepJob, *, replace: bool = False) -> SweepStore:
    """Make an empty store; it appears whole or not at all.

    Args:
        path: Its folder.
        job: What its records will be of.
        replace: Whether it takes the place of a store that is there; that one goes when the new one is written.

    Returns:
        The store.

    Raises:
        ResultFileError: It exists, or cannot be made.
    """
    import zarr

    if path.exists():
        if not replace:
            raise ResultFileError(f"{path} exists already")
        open_store(path)  # refuses to replace what is no store
    partial = path.with_name(f".{path.name}.partial")
    try:
        shutil.rmtree(partial, ignore_errors=True)
        group = zarr.open_group(partial, mode="w-", zarr_format=3)
        group.attrs.update({_IDENTITY: job.identity(), "kind": job.kind})
        axes, fields = job.store_axes, job.fields
        for name, axis in axes.items():
            array = group.create_array(name, shape=axis.values.shape, dtype=axis.values.dtype, dimension_names=(name,))
            array[...] = axis.values
            array.attrs.update(units=axis.unit, long_name=axis.meaning)
        records = group.create_array(
            "records",
            shape=(*(len(axis.values) for axis in axes.values()), len(fields)),
            chunks=(*(1 for _ in axes), len(fields)),
            dtype="float64",
            fill_value=np.nan,
            compressors=None,
            dimension_names=(*axes, "field"),
        )
        records.attrs["fields"] = [
            {"name": name, "units": field.unit, "long_name": field.meaning} for name, field in fields.items()
        ]
        if path.exists():
            shutil.rmtree(path)
        partial.rename(path)
    except OSError as error:
        raise ResultFileError(f"cannot make the store {path}: {error.strerror or error}") from error
    return open_store(path)


def open_store(path: Path, job: SweepJob | None = None) -> SweepStore:
    """Open a store to read it or to go on with it.

    Args:
        path: Its folder.
        job: What the records to come are of; None takes whatever is there.

    Returns:
        The store.

    Raises:
        ResultFileError: There is none, it cannot be read, or its records are of something else.
    """
    import zarr

    if not path.is_dir():
        raise ResultFileError(f"there is no store at {path}")
    try:
        group = zarr.open_group(path, mode="r+")
        attributes: dict[str, Any] = group.attrs.asdict()
        stored, kind = dict(attributes[_IDENTITY]), str(attributes["kind"])
        records: Any = group["records"]
        names = [field["name"] for field in records.attrs["fields"]]
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise ResultFileError(f"cannot read {path} as the store of a sweep: {error}") from error
    if job is not None:
        if kind != job.kind:
            raise ResultFileError(f"the store {path} is of another kind of map: {kind}, not {job.kind}")
        if names != list(job.fields):
            raise ResultFileError(f"the store {path} is from another version: its records hold {', '.join(names)}")
        # Through JSON and back: tuples become lists, as they did in the store.
        wanted = json.loads(json.dumps(job.identity()))
        different = _differences(stored, wanted)
        if different:
            raise ResultFileError(
                f"the store {path} is of something else: {'; '.join(different[:4])}; "
                "name another folder with --out, or use --force"
            )
    return SweepStore(path, kind, stored, records)


def _differences(stored: Any, wanted: Any, name: str = "") -> list[str]:
    """What differs between two nests of plain values, each in a few words."""
    if isinstance(stored, dict) and isinstance(wanted, dict):
        found = []
        for key in sorted({*stored, *wanted}):
            found += _differences(stored.get(key), wanted.get(key), f"{name}.{key}" if name else str(key))
        return found
    if stored == wanted:
        return []
    return [f"{name} is {_short(stored)} there and {_short(wanted)} here"]


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
