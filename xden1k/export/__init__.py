"""Objects as files for simulators, viewers and other libraries: one module a format.

``exporting`` puts an object in its place and checks it; ``body`` makes it a rigid body in SI
(``si``), with shapes that stay closed (``closed``, ``hulls``) and names that can be held
(``names``); ``mjcf``, ``urdf``, ``sdf``, ``usd``, ``glb``, ``obj``, ``nifti``, ``vti``, ``npz`` and
``hdf5`` write.
"""

from xden1k.export.check import Deviation
from xden1k.export.exporting import FORMATS, Exported, export, export_stack, exported

__all__ = ["FORMATS", "Deviation", "Exported", "export", "export_stack", "exported"]
