"""Turns of what is nearly a ball: where its seams and its valve are.

A ball turned anyhow has the same outline, and clouds of points do not see a seam. Its middle is
known, though, so that the whole of SO(3) comes from few renderings: one for each direction that it
is looked at from. A turn about the line of sight turns that image about its middle, and all such
turns are compared at once by a Fourier transform around rings. Two views tell a rotation by a look
into the table of each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Complex128, Float64, Int64
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from xden1k.rays import disjoint_path_lengths
from xden1k.values.arrays import Vec3
from xden1k.values.views import ViewGeometry
from xden_builder.poly.model.direct import transmissions
from xden_builder.registration.body import Body, spread_directions
from xden_builder.registration.exact import Judge
from xden_builder.registration.likeness import Likeness
from xden_builder.registration.placement import Found, RigidPlacement
from xden_builder.registration.rotations import spread_rotations
from xden_builder.registration.shortlist import Poses, distinct
from xden_builder.registration.turns import same_share

__all__ = ["ball_turns", "is_ball"]

BALL_SHARE: Final = 0.03
"""Of the radius: what any turn moves less is nearly a ball."""
PROBED: Final = 12
"""Turns that are tried for that."""
DIRECTIONS, SIDE_PX = 640, 64
"""From which it is rendered, 8 degrees apart, and pixels of such an image along each side."""
RINGS, ANGLES = 24, 120
"""Around the middle of an image, and places on each."""
BLUR_PX: Final = 1.5
"""Of the rendered images: half of what turns that are looked up are off by."""
MARGIN: Final = 1.1
ALL_KNOWN: Final = 0.99
"""Share of the pixels around a place that are known where it is."""
MOST: Final = 8
"""Turns that are given."""

Frames = Float64[np.ndarray, "n 3 3"]
"""Right-handed, one vector a row; the last points to the source."""


def is_ball(body: Body, likeness: Likeness) -> bool:
    """Whether an object is nearly the same however it is turned, but not quite."""
    here, middle = RigidPlacement(np.eye(3), np.zeros(3)), body.spin[0]
    turned = [
        RigidPlacement(turn, middle - turn @ middle)
        for turn in spread_rotations(PROBED).as_matrix()
    ]
    like = not any(likeness.apart(here, each, BALL_SHARE * body.radius_cm) for each in turned)
    least_cm = same_share(body) * body.radius_cm
    return like and any(likeness.strict.apart(here, each, least_cm) for each in turned)


def ball_turns(judge: Judge, found: Found) -> list[RigidPlacement]:
    """Turn a settled pose about its middle to wherever its images are most alike.

    Parameters
    ----------
    judge
        Has the images.
    found
        The pose, its densities and gains.

    Returns
    -------
    list of RigidPlacement
        Of unlike rotations, the most alike first.
    """
    own, middle = judge.body.placed(found.placement), judge.body.spin[0]
    rings = _Rings(float(np.linalg.norm(judge.body.points_cm - middle, axis=1).max()))
    at = own.apply(middle[None])[0]
    eyes = [
        _Eye.of(judge, found, number, at, own.scale, rings)
        for number, turned in enumerate(judge.scene.turned)
        if not turned
    ]
    faces = _frames(spread_directions(DIRECTIONS))
    density = own.scale * found.density_g_cm3  # of ways through meshes as they are
    table = _Table.of(judge, density, faces, eyes[0], rings)
    costs = [table.costs(eye) for eye in eyes]
    rotations = _all_turns(eyes[0], faces)
    total = costs[0].ravel()
    for eye, cost in zip(eyes[1:], costs[1:], strict=True):
        total = total + cost[_looked_up(rotations, eye, faces)]
    linear = own.scale * rotations
    poses = Poses(linear, at - linear @ middle, total).best_first()
    kept = poses.picked(distinct(poses, MOST, None)).placements()
    return [judge.body.of_files(each) for each in kept]


@dataclass(frozen=True, slots=True)
class _Rings:
    """Places on circles around the middle of an image.

    Parameters
    ----------
    radius_cm
        Of the object.
    """

    radius_cm: float

    @property
    def radii_cm(self) -> Float64[np.ndarray, "rings"]:
        """Of the circles."""
        return np.asarray((np.arange(RINGS) + 0.5) / RINGS * self.radius_cm)

    @property
    def places_cm(self) -> Float64[np.ndarray, "2 rings angles"]:
        """Along both axes of the image."""
        unit = np.stack([np.cos(_angles_rad()), np.sin(_angles_rad())])
        return np.asarray(unit[:, None] * self.radii_cm[:, None])

    def spectra(
        self, values: Float64[np.ndarray, "rings angles"]
    ) -> Complex128[np.ndarray, "rings waves"]:
        """Transform around each circle; its mean, which no turn changes, is left out."""
        waves = np.fft.rfft(values, axis=1)
        waves[:, 0] = 0
        return np.asarray(waves * np.sqrt(self.radii_cm)[:, None])


@dataclass(frozen=True, slots=True, eq=False)
class _Eye:
    """A view as it sees the middle of the object.

    Parameters
    ----------
    frame
        Shape (3, 3): across the line of sight, and along it to the source, one a row.
    away_cm
        From the middle to the source, in the object's own length; None for a parallel beam.
    spectra
        Shape (rings, waves): of the measured image.
    weights
        Shape (1, groups): shares of the energy groups.
    """

    frame: Float64[np.ndarray, "3 3"]
    away_cm: float | None
    spectra: Complex128[np.ndarray, "rings waves"]
    weights: Float64[np.ndarray, "1 groups"]

    @classmethod
    def of(
        cls, judge: Judge, found: Found, number: int, middle_cm: Vec3, scale: float, rings: _Rings
    ) -> _Eye:
        """Read the measured image around the middle."""
        view, beam = judge.scene.views[number].geometry, judge.scene.outlines.beams[number]
        panel, averaged = judge.panel(number), judge.images[number]
        way = _to_source(view, middle_cm)
        frame = _frames(way[None] / np.linalg.norm(way))[0]
        places = np.tensordot(rings.places_cm, scale * frame[:2], axes=(0, 0)) + middle_cm
        column, row, _ = panel.project(places.reshape(-1, 3)).T
        gain = 1.0 if found.gains is None else float(found.gains[number])
        told_px = averaged.known & ~averaged.at_least
        seen, told = (
            map_coordinates(each, [row, column], order=1, mode="nearest").reshape(RINGS, ANGLES)
            for each in (np.float64(averaged.image) / gain, np.float64(told_px))
        )
        away = None if view.source_cm is None else float(np.linalg.norm(way)) / scale
        middle = int(np.ravel_multi_index((panel.shape[0] // 2, panel.shape[1] // 2), panel.shape))
        weights = beam.weights(np.array([middle]), judge.binning)
        return cls(frame, away, rings.spectra(_filled(seen, told > ALL_KNOWN)), weights)


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    """Images of the object from all directions.

    Parameters
    ----------
    spectra
        Shape (n, rings, waves).
    powers
        Shape (n,): sums of their squares around all rings.
    """

    spectra: Complex128[np.ndarray, "n rings waves"]
    powers: Float64[np.ndarray, "n"]

    @classmethod
    def of(
        cls,
        judge: Judge,
        density_g_cm3: Float64[np.ndarray, "k"],
        faces: Frames,
        eye: _Eye,
        rings: _Rings,
    ) -> _Table:
        """Render them, as far away as an eye is."""
        body, regions = judge.body, judge.scene.space.regions
        middle = body.middle_cm + body.spin[0]
        pitch = 2 * MARGIN * rings.radius_cm / SIDE_PX
        half, places = (SIDE_PX - 1) / 2, rings.places_cm / pitch
        spectra = []
        for across, down, along in faces:
            panel = ViewGeometry(
                beam="parallel" if eye.away_cm is None else "cone",
                pixel00_cm=middle - pitch * half * (across + down),
                column_step_cm=pitch * across,
                row_step_cm=pitch * down,
                shape=(SIDE_PX, SIDE_PX),
                source_cm=None if eye.away_cm is None else middle + eye.away_cm * along,
                direction=-along if eye.away_cm is None else None,
            )
            seen = disjoint_path_lengths(regions, panel)
            image = np.ones(SIDE_PX**2)
            image[seen.pixels] = transmissions(
                seen.lengths_cm,
                np.repeat(eye.weights, len(seen.pixels), axis=0),
                judge.mac_cm2_g,
                density_g_cm3,
            )
            blurred = gaussian_filter(image.reshape(SIDE_PX, SIDE_PX), BLUR_PX)
            spectra.append(rings.spectra(map_coordinates(blurred, half + places[::-1], order=1)))
        whole = np.array(spectra)
        return cls(whole, _powers(whole))

    def costs(self, eye: _Eye) -> Float64[np.ndarray, "n angles"]:
        """Squares of what each image leaves, turned by each angle; less a constant."""
        both = (eye.spectra * self.spectra.conj()).sum(axis=1)
        return np.asarray(self.powers[:, None] - 2 * np.fft.irfft(both, n=ANGLES, axis=1))


def _powers(spectra: Complex128[np.ndarray, "n rings waves"]) -> Float64[np.ndarray, "n"]:
    """Sum squares around rings, by their transforms (Parseval)."""
    square = np.abs(spectra) ** 2
    return np.asarray((2 * square.sum(axis=(1, 2)) - square[..., -1].sum(axis=1)) / ANGLES)


def _filled(
    values: Float64[np.ndarray, "rings angles"], known: Bool[np.ndarray, "rings angles"]
) -> Float64[np.ndarray, "rings angles"]:
    """Give what is not known the mean of its ring, which no turn changes."""
    counts = known.sum(axis=1, keepdims=True).clip(min=1)
    mean = np.where(known, values, 0.0).sum(axis=1, keepdims=True) / counts
    return np.where(known, values, mean)


def _to_source(view: ViewGeometry, middle_cm: Vec3) -> Vec3:
    """Way from the middle to the source, or against a parallel beam."""
    if view.source_cm is not None:
        return np.asarray(view.source_cm - middle_cm)
    assert view.direction is not None
    return -view.direction


def _angles_rad() -> Float64[np.ndarray, "angles"]:
    return 2 * np.pi * np.arange(ANGLES) / ANGLES


def _frames(along: Float64[np.ndarray, "n 3"]) -> Frames:
    """Complete unit vectors to right-handed frames, of which they are the last."""
    helpers = np.eye(3)[np.abs(along).argmin(axis=1)]
    across = np.cross(helpers, along)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return np.stack([across, np.cross(along, across), along], axis=1)


def _all_turns(eye: _Eye, faces: Frames) -> Float64[np.ndarray, "b 3 3"]:
    """Rotations that show an eye each face, turned by each angle."""
    shown = eye.frame.T @ faces
    turns = Rotation.from_rotvec(np.outer(_angles_rad(), eye.frame[2])).as_matrix()
    return np.asarray((turns @ shown[:, None]).reshape(-1, 3, 3))


def _looked_up(
    rotations: Float64[np.ndarray, "b 3 3"], eye: _Eye, faces: Frames
) -> tuple[Int64[np.ndarray, "b"], Int64[np.ndarray, "b"]]:
    """Which face each rotation about shows an eye, and turned by which angle."""
    sight = eye.frame[2] @ rotations
    _, face = cKDTree(faces[:, 2]).query(sight)
    axis = np.cross(faces[face, 2], sight)
    sine = np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.arctan2(sine[:, 0], (sight * faces[face, 2]).sum(axis=1))
    back = Rotation.from_rotvec(axis * (angle / sine[:, 0].clip(min=1e-12))[:, None])
    across = np.einsum("bij,bj->bi", rotations, back.apply(faces[face, 0]))
    turned = np.arctan2(across @ eye.frame[1], across @ eye.frame[0])
    number = np.round(turned / (2 * np.pi) * ANGLES).astype(int) % ANGLES
    return face, number
