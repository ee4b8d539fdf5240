"""Another X-ray simulator than ours, to judge the builder by.

It shares the shapes and names of :mod:`xden_builder.phantoms` and nothing else: path lengths are
those of gVirtualXray, tubes those of SpekPy, coefficients those of xraylib, and the substances have
a table of their own. Reading order: ``substances``, ``matter`` (attenuation), ``tube``, ``screen``
(what the panel makes of photons), ``rays``, ``scatter``, ``setup`` (one scanner, and what is told
of it), ``objects`` (one object, and what is told of it), ``radiograph``, ``writer``.
"""
