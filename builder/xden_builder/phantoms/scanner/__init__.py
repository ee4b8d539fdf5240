"""The simulated scanner: what its tube sends, its panel receives and its operators cannot know.

Reading order: ``model`` (every effect is one of its fields), ``beam`` (spectrum and heel),
``composition`` (that is not the library's), ``primary`` (the direct beam, blurred), ``scatter``,
``panel`` (noise, converter, calibration), ``handover`` (errors of the part meshes), ``turning``
(one tube), ``file`` (TOML), ``effects`` (how much each matters).
"""

from xden_builder.phantoms.scanner.file import load_scanner, panel_name, scanner_file
from xden_builder.phantoms.scanner.model import VIEWS, Raw, Scanner
from xden_builder.phantoms.scanner.panel import Calibration
from xden_builder.phantoms.scanner.signal import Signal

__all__ = [
    "VIEWS",
    "Calibration",
    "Raw",
    "Scanner",
    "Signal",
    "load_scanner",
    "panel_name",
    "scanner_file",
]
