"""The polychromatic fit: from two radiographs, part meshes and a tube to densities.

Unknown are the density of each part, the material where no label says it, a gain and the strength
of scatter and glare in each view, and the pose of the meshes. Modules, in the order of their work:
:mod:`beam` (energies that reach each pixel), :mod:`candidates` (what a part may be made of and how
dense that is), :mod:`pose` (meshes onto their shadows), :mod:`pixels` (what is compared),
:mod:`posterior` (densities by maximum a posteriori), :mod:`evidence` (which material), and
:mod:`estimate`, which runs them.
"""
