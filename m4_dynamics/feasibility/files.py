"""Maps as files: NetCDF, whole or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from m4_dynamics.errors import ResultFileError
from m4_dynamics.output import replacing

if TYPE_CHECKING:
    import xarray

__all__ = ["MAP_FILE", "load_map", "save_map"]

MAP_FILE = "map.nc"


def save_map(dataset: xarray.Dataset, path: Path | str) -> Path:
    """Write a map as NetCDF-4.

    Args:
        dataset: The map.
        path: The file; its folder exists.

    Returns:
        The path.

    Raises:
        ResultFileError: The file cannot be written.
    """
    target = Path(path)
    encoding: dict[Any, dict[str, Any]] = {
        name: {"zlib": True, "complevel": 1} for name, variable in dataset.data_vars.items() if variable.ndim > 1
    }
    # In memory first: HDF5 crashes when the disk is full while it closes a file.
    content = dataset.to_netcdf(engine="h5netcdf", encoding=encoding)
    with replacing(target) as partial:
        partial.write_bytes(content)
    return target


def load_map(path: Path | str) -> xarray.Dataset:
    """Read a map.

    Args:
        path: The file, or the folder that holds it as map.nc.

    Returns:
        The map, in memory.

    Raises:
        ResultFileError: There is none, or it is something else.
    """
    import xarray

    source = Path(path)
    if source.is_dir():
        source = source / MAP_FILE
    try:
        with xarray.open_dataset(source, engine="h5netcdf") as dataset:
            loaded = dataset.load()
    except FileNotFoundError as error:
        raise ResultFileError(f"no map at {source}") from error
    except (OSError, ValueError) as error:
        raise ResultFileError(f"cannot read {source} as a map: {error}") from error
    if "kind" not in loaded.attrs:
        raise ResultFileError(f"{source} is no map: it does not say its kind")
    return loaded
