"""Reading a capture folder: what came off the scanner and the annotation desk."""

from xden_builder.capture.ct import CTReference
from xden_builder.capture.dicom import dicom_pixel_spacing_cm
from xden_builder.capture.folder import Capture, CaptureFolder, ObjectRow
from xden_builder.capture.formats import read_image
from xden_builder.capture.images import ImageFile
from xden_builder.capture.parts import CapturePart
from xden_builder.capture.pose import Candidate, CoarsePose, PoseTold
from xden_builder.capture.scanner import (
    ScannerFile,
    ViewFile,
    read_scanner,
    write_scanner,
)

__all__ = [
    "CTReference",
    "Candidate",
    "Capture",
    "CaptureFolder",
    "CapturePart",
    "CoarsePose",
    "ImageFile",
    "ObjectRow",
    "PoseTold",
    "ScannerFile",
    "ViewFile",
    "dicom_pixel_spacing_cm",
    "read_image",
    "read_scanner",
    "write_scanner",
]
