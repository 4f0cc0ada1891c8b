"""Reports of single cells inside a map's folder: what such a run says of its cell, and how the map's page finds it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import xarray

from m4_dynamics.feasibility.cell import CellIndex

__all__ = ["CellReport", "cell_record", "find_cell_reports"]

_REPORT, _SUMMARY = "report.html", "summary.json"


@dataclass(frozen=True, slots=True)
class CellReport:
    """The report of one cell.

    Attributes:
        index: The cell and the number of its start.
        verdict: How the run ended, on the full model; the map itself may be of the reduced one.
        folder: Name of the run's folder inside the map's.
    """

    index: CellIndex
    verdict: str
    folder: str

    @property
    def href(self) -> str:
        """Where it is, as seen from a page in the map's folder."""
        return f"{quote(self.folder, safe='')}/{_REPORT}"


def cell_record(fingerprint: str, index: CellIndex) -> dict[str, Any]:
    """What a run's summary says of the cell that it replays.

    Args:
        fingerprint: Of the map's store.
        index: The cell.

    Returns:
        An entry of the summary.
    """
    return {"cell": {"map": fingerprint, **index._asdict()}}


def find_cell_reports(dataset: xarray.Dataset, folder: Path) -> tuple[CellReport, ...]:
    """Find the reports in a map's folder that are of this very map.

    A folder may hold runs of a map that has been replaced since: a run counts if its summary names this map's
    fingerprint. Links to other folders are not followed, since they would break when the map's is moved.

    Args:
        dataset: A closed-loop map; others have no reports.
        folder: The map's folder.

    Returns:
        The reports, in the order of the cells.
    """
    fingerprint = dataset.attrs.get("fingerprint")
    if fingerprint is None:
        return ()
    sizes = CellIndex(*(dataset.sizes[name] for name in CellIndex._fields))
    found = []
    for summary in folder.glob(f"*/{_SUMMARY}"):
        run = summary.parent
        if run.is_symlink() or not (run / _REPORT).is_file():
            continue
        try:
            facts = json.loads(summary.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue  # not a run's, or only half copied: nothing says what the report is of
        match facts:
            case {
                "verdict": str(verdict),
                "cell": {"map": str(of), "friction": int(m), "slope": int(i), "thrust": int(j), "start": int(n)},
            } if of == fingerprint and all(0 <= k < size for k, size in zip((m, i, j, n), sizes, strict=True)):
                found.append(CellReport(CellIndex(m, i, j, n), verdict, run.name))
    return tuple(sorted(found, key=lambda one: (one.index, one.folder)))
