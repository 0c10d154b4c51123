"""Photographs of cameras and telephones that need a package of their own: raw files and HEIF."""

from __future__ import annotations

from importlib import import_module
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.bayer_image import BayerImage, bayer_image
from fringeworks.files.limits import check_frame_size
from fringeworks.types import MissingPackage

RAW_SUFFIXES = (
    *(".dng", ".cr2", ".cr3", ".nef", ".nrw", ".arw", ".raf", ".orf", ".rw2", ".rwl", ".pef"),
    *(".srw", ".3fr", ".iiq", ".erf", ".kdc"),
)
"""Raw files of cameras, which rawpy reads."""
HEIF_SUFFIXES = (".heic", ".heif", ".hif")
"""Photographs of telephones, which pillow-heif reads."""
PHOTOGRAPH_SUFFIXES = (*RAW_SUFFIXES, *HEIF_SUFFIXES)
"""What this file reads."""
RAW_BITS = 16
"""Bits of the counts that a raw file becomes."""


def read_photograph(content: bytes, suffix: str) -> tuple[NDArray[Any] | BayerImage, bool]:
    """Read a raw file or HEIF.

    Parameters
    ----------
    content : bytes
        Of the file.
    suffix : str
        One of ``PHOTOGRAPH_SUFFIXES``.

    Returns
    -------
    counts : (h, w, 3) array, or BayerImage
        Of a raw file: uint16, proportional to the light; the channels as the sensor has them,
        without white balance, and interpolated linearly between its pixels. Of HEIF: uint8.
    lossy : bool
        Whether the file is lossily compressed; raw files are taken for lossless.

    Raises
    ------
    MissingPackage without the package. They are not among the extras: the wheels of rawpy and
    pillow-heif hold libraries under the LGPL and the GPL.
    """
    if suffix in RAW_SUFFIXES:
        rawpy = _package("rawpy", f"raw photographs ({suffix})")
        with rawpy.imread(BytesIO(content)) as raw:
            check_frame_size(raw.sizes.width, raw.sizes.height)
            mosaic = bayer_image(raw)
            if mosaic is not None:
                return mosaic, False
            counts = raw.postprocess(
                demosaic_algorithm=rawpy.DemosaicAlgorithm.LINEAR,
                output_color=rawpy.ColorSpace.raw,
                user_wb=[1.0, 1.0, 1.0, 1.0],
                gamma=(1, 1),
                no_auto_bright=True,
                # LibRaw would otherwise scale each frame by its own brightest pixel.
                adjust_maximum_thr=0.0,
                output_bps=RAW_BITS,
                user_flip=0,
            )
        return np.asarray(counts), False
    heif = _package("pillow_heif", f"{suffix} photographs")
    image = heif.open_heif(BytesIO(content), convert_hdr_to_8bit=True)
    check_frame_size(*image.size)
    return np.asarray(image), True


def _package(name: str, what: str) -> Any:
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        installed = name.replace("_", "-")
        raise MissingPackage(
            f"{what}: expected the package {installed}, got none; pip install {installed}, or "
            "convert the files to TIFF or PNG"
        ) from error
