"""Small problems for the fit: random path lengths, and solids seen by a cone beam."""

from dataclasses import replace

import numpy as np

from xden1k.rays import PathLengths, path_lengths
from xden1k.values.views import ViewGeometry, XRayView

FRAME = (24, 24)
FLAT = ViewGeometry(
    beam="parallel",
    pixel00_cm=np.zeros(3),
    column_step_cm=np.array([0.1, 0.0, 0.0]),
    row_step_cm=np.array([0.0, 0.0, -0.1]),
    shape=FRAME,
    direction=np.array([0.0, 1.0, 0.0]),
)


def random_lengths(rng, parts, rays=1, met=0.6):
    """A square of 10 x 10 pixels in a frame of 24 x 24, each ray meeting some of the parts."""
    pixels = np.array([row * FRAME[1] + column for row in range(7, 17) for column in range(7, 17)])
    shape = (len(pixels), rays, parts)
    lengths = rng.uniform(0.1, 1.0, shape) * (rng.uniform(size=shape) < met)
    return PathLengths(
        pixels,
        lengths.astype(np.float32),
        np.zeros(len(pixels), dtype=np.float32),
        np.zeros(len(pixels), dtype=bool),
        FRAME,
    )


def ideal_view(name, lengths, lac, gain=1.0, geometry=FLAT):
    """The radiograph a perfect scanner takes."""
    image = lengths.image(np.asarray(lac, dtype=np.float64), gain)
    return XRayView(name, image, np.ones(image.shape, dtype=bool), geometry)


def random_views(rng, lac, gains=(1.0, 1.0), rays=1, met=0.6):
    lengths = [random_lengths(rng, len(lac), rays, met) for _ in gains]
    return [
        (each, ideal_view(name, each, lac, gain))
        for name, each, gain in zip(("pa", "lat"), lengths, gains, strict=False)
    ]


def with_noise(views, rng, quanta=20_000.0, readout=20.0):
    """Poisson noise of the quanta and normal noise of the readout."""
    return [
        (
            lengths,
            replace(
                view,
                transmission=(
                    (
                        rng.poisson(view.transmission.astype(np.float64) * quanta)
                        + rng.normal(0.0, readout, view.transmission.shape)
                    )
                    / quanta
                ).astype(np.float32),
            ),
        )
        for lengths, view in views
    ]


def changed(view, change):
    """The view with another transmission."""
    image = view.transmission.copy()
    change(image)
    return replace(view, transmission=image)


def cone(angle_degrees, size, width_cm):
    """A cone beam from 100 cm onto a detector 30 cm behind the origin, turned about z."""
    angle = np.radians(angle_degrees)
    beam = np.array([np.cos(angle), np.sin(angle), 0.0])
    across = np.array([-np.sin(angle), np.cos(angle), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    step = width_cm / size
    corner = 30.0 * beam + (up - across) * step * (size - 1) / 2
    return ViewGeometry("cone", corner, across * step, -up * step, (size, size), -100.0 * beam)


def solid_views(meshes, lac, size=96, width_cm=12.0, rays=1, true_rays=1):
    """Both views of solids, the first owning the space where they overlap."""
    views = []
    for name, angle in (("pa", 90.0), ("lat", 0.0)):
        geometry = cone(angle, size, width_cm)
        order = range(len(meshes))
        truth = path_lengths(meshes, order, geometry, true_rays)
        lengths = truth if rays == true_rays else path_lengths(meshes, order, geometry, rays)
        views.append((lengths, ideal_view(name, truth, lac, geometry=geometry)))
    return views
