"""Write ``.npz`` files whose bytes depend on the arrays alone."""

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

_FIXED_DATE = (1980, 1, 1, 0, 0, 0)


def write_npz(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write `arrays` in the given order, C-contiguous, little-endian, stored without compression.

    `numpy.savez` stamps the time of writing into the archive, and deflate streams differ between zlib
    versions; stored members with a fixed date do neither. The wheel compresses the file anyway.

    Parameters
    ----------
    path : Path
        File to write.
    arrays : mapping of str to ndarray
        What it holds.
    """
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for name, array in arrays.items():
            buffer = io.BytesIO()
            plain = np.asarray(array, order="C")
            little = plain.astype(plain.dtype.newbyteorder("<"), copy=False)
            np.lib.format.write_array(buffer, little, version=(1, 0), allow_pickle=False)
            member = zipfile.ZipInfo(f"{name}.npy", date_time=_FIXED_DATE)
            member.create_system = 3
            member.external_attr = 0o644 << 16
            archive.writestr(member, buffer.getvalue())
