"""The polychromatic fit: from radiographs, part meshes and a tube to densities.

Unknown are the density of each part, the material where no label says it, a gain and the strength
of scatter and glare in each view, and the pose of the meshes. The fit is a line of stages, each of
which takes the value that the one before it made (:func:`xden_builder.poly.line.fit_poly`):

===================  ==================  ========================================================
:mod:`scene`         ``Scene``           beams, and what each part may be
:mod:`start`         ``Guess``           each part taken for one material
:mod:`pose`          ``Placement``       meshes onto their shadows
:mod:`samples`       ``Samples``         path lengths there, and the pixels that are compared
:mod:`estimate`      ``Solution``        densities and materials, in turn
:mod:`weighed`       ``Solution``        the same by a mass, too, if the object was on a scale
:mod:`judgement`     ``PolyFit``         densities with their uncertainty and flags
===================  ==================  ========================================================

What the stages use: :mod:`model` (what a radiograph of known densities looks like),
:mod:`materials` (what a part may be made of, and how probable that is), :mod:`posterior` (the
function that is minimised).
"""
