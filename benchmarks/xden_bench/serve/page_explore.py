"""The object explorer's page. Needs the extras ``view`` and ``build``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import gradio as gr
import numpy as np

from xden1k.types import FIELD_SIZE, DensityObject
from xden_bench.metrics import METRICS
from xden_bench.protocol import load_protocol
from xden_bench.serve.explorer import COLOURS, PART_HEADINGS, Explorer, Fields, best_and_worst
from xden_bench.serve.figures import AXES
from xden_bench.serve.glb import M_PER_CM
from xden_bench.serve.told import GRID, PICTURE, PRIVATE, frame, offer, told

__all__ = ["explore_page", "object_line"]

Entries = Callable[[], tuple[dict[str, Any], ...]]

NO_METHOD: Final = "none: the truth alone"
SOURCES: Final = {
    "scan": "scan; the truth is the builder's reconstruction",
    "phantom": "phantom: simulated, never on a scanner",
    "ct": "ct: views computed from a CT",
}
RADIOGRAPHS: Final = (
    "### Radiographs\n\nThe reprojection is of the dataset's own parts: exact path lengths through "
    "their meshes with the stored attenuation and geometry, one coefficient for each part. It is "
    "not of the chosen method: a density says nothing of attenuation without the material."
)
SLICES: Final = (
    "### Slices\n\nVoxel means. White: outside the outer surface, where nothing is scored. Truth "
    "and prediction share one colour scale, that of the whole object."
)
WHITE: Final = (1.0, 1.0, 1.0, 1.0)
VIEW_DEGREES: Final = (60, 65)
"""Of the camera: around the object, and down from the vertical."""
VIEW_DISTANCE: Final = 1.6
"""Of the camera, in diagonals of the object."""


class _Page:
    """The components and the answers to their events."""

    def __init__(self, explorer: Explorer, entries: Entries, results: Path) -> None:
        self.explorer, self.entries, self.results = explorer, entries, results
        with gr.Row():
            self.split = gr.Dropdown(label="Split", min_width=110, scale=1)
            self.object = gr.Dropdown(label="Object", elem_id="object", scale=3)
            self.method = gr.Dropdown(label="Method", elem_id="method", scale=4)
        self.line = gr.Markdown(elem_id="line", elem_classes="note")
        with gr.Row():
            with gr.Column(scale=1, min_width=330):
                self.model = gr.Model3D(
                    label="Parts", height=420, elem_id="model", clear_color=WHITE
                )
                self.bar = gr.Image(container=False, elem_id="bar", **PICTURE)
                with gr.Row():
                    self.colour = gr.Radio(COLOURS, value="density", label="Coloured by")
                    self.cut = gr.Checkbox(
                        label="Cut open", info="without its front half", elem_id="cut"
                    )
            with gr.Column(scale=1, min_width=330):
                self.parts = gr.Dataframe(label="Parts", elem_id="parts", **GRID)
        self._slices_part()
        gr.Markdown(RADIOGRAPHS)
        self.radiographs = []
        for view in ("PA", "LAT"):
            with gr.Row():
                self.radiographs += [
                    gr.Image(height=360, min_width=300, elem_id=f"{view}-{place}", **PICTURE)
                    for place in range(3)
                ]
        self._extremes_part()
        self._listen()

    def _slices_part(self) -> None:
        gr.Markdown(SLICES)
        with gr.Row():
            self.axis = gr.Radio(
                AXES, value="y", label="Perpendicular to", min_width=160, elem_id="axis"
            )
            self.index = gr.Slider(
                0, FIELD_SIZE - 1, FIELD_SIZE // 2, step=1, label="Voxel", scale=3, elem_id="slice"
            )
        self.place = gr.Markdown(elem_id="place", elem_classes="note")
        with gr.Row():
            self.slices = [
                gr.Image(height=380, min_width=300, elem_id=f"slice-{name}", **PICTURE)
                for name in ("truth", "prediction", "error")
            ]

    def _extremes_part(self) -> None:
        with gr.Column(visible=False) as self.extremes:
            gr.Markdown("### Best and worst objects of the method\n\nClick on one to open it.")
            self.metric = gr.Dropdown(label="By", elem_id="by")
            with gr.Row():
                with gr.Column(min_width=330):
                    self.best = gr.Dataframe(label="Best", elem_id="best", **GRID)
                with gr.Column(min_width=330):
                    self.worst = gr.Dataframe(label="Worst", elem_id="worst", **GRID)

    def _listen(self) -> None:
        gr.on(
            [self.split.input, self.object.input, self.method.input],
            self.fill,
            self.inputs,
            self.outputs,
            **PRIVATE,
        )
        chosen = [self.split, self.object, self.method]
        gr.on(
            [self.colour.input, self.cut.input],
            self.draw_model,
            [*chosen, self.colour, self.cut],
            [self.model, self.bar],
            **PRIVATE,
        )
        gr.on(
            [self.axis.input, self.index.change],
            self.draw_slices,
            [*chosen, self.axis, self.index],
            [self.place, *self.slices],
            trigger_mode="always_last",
            show_progress="hidden",
            **PRIVATE,
        )
        self.metric.input(
            self.list_extremes,
            [self.split, self.method, self.metric],
            [self.extremes, self.metric, self.best, self.worst],
            **PRIVATE,
        )
        for table in (self.best, self.worst):
            table.select(self.open_row, None, self.object, **PRIVATE).then(
                self.fill, self.inputs, self.outputs, **PRIVATE
            )

    @property
    def inputs(self) -> list[Any]:
        chosen = [self.split, self.object, self.method]
        return [*chosen, self.colour, self.cut, self.axis, self.index, self.metric]

    @property
    def outputs(self) -> list[Any]:
        return [
            *(self.split, self.object, self.method, self.line, self.parts, self.model, self.bar),
            *(self.place, *self.slices, *self.radiographs),
            *(self.extremes, self.metric, self.best, self.worst),
        ]

    @told
    def fill(
        self,
        split: str | None,
        object_id: str | None,
        method: str | None,
        colour: Any,
        cut: bool,
        axis: str,
        index: int,
        metric: str | None,
    ) -> list[Any]:
        splits, split = offer(self.explorer.splits, split)
        objects, object_id = offer(self.explorer.folder.ids(split), object_id)
        labels = [NO_METHOD, *self.explorer.methods(self.entries(), split)]
        methods, method = offer(labels, method)
        fields = self._fields(split, object_id, method)
        return [
            *(splits, objects, methods),
            object_line(fields.obj) + self._missing_note(fields, method),
            frame(PART_HEADINGS, self.explorer.parts(object_id)),
            *self._model(fields, colour, cut),
            *self._slices(fields, axis, index),
            *self.explorer.radiographs(object_id),
            *self._extremes(split, method, metric),
        ]

    @told
    def draw_model(
        self, split: str, object_id: str, method: str, colour: Any, cut: bool
    ) -> list[Any]:
        return self._model(self._fields(split, object_id, method), colour, cut)

    @told
    def draw_slices(
        self, split: str, object_id: str, method: str, axis: str, index: int
    ) -> list[Any]:
        return self._slices(self._fields(split, object_id, method), axis, index)

    @told
    def list_extremes(self, split: str, method: str, metric: str) -> list[Any]:
        return self._extremes(split, method, metric)

    @told
    def open_row(self, event: gr.SelectData) -> Any:
        return event.row_value[0] if event.row_value else gr.skip()

    def _row(self, split: str, method: str | None) -> Any:
        return self.explorer.methods(self.entries(), split).get(method or "")

    def _fields(self, split: str, object_id: str, method: str | None) -> Fields:
        return self.explorer.fields(object_id, self._row(split, method))

    def _missing_note(self, fields: Fields, method: str | None) -> str:
        if method == NO_METHOD or fields.guess is not None:
            return ""
        return (
            "\n\n**The predictions of this method are not stored here**, so its slices and its "
            "error cannot be drawn; its best and worst objects are below."
        )

    def _model(self, fields: Fields, colour: Any, cut: bool) -> list[Any]:
        path, bar = self.explorer.model(fields, colour, cut)
        bounds = np.array([part.mesh.bounds for part in fields.obj.parts])
        size_m = M_PER_CM * float(np.linalg.norm(bounds[:, 1].max(0) - bounds[:, 0].min(0)))
        camera = (*VIEW_DEGREES, VIEW_DISTANCE * size_m)
        return [gr.Model3D(str(path), camera_position=camera), bar]

    def _slices(self, fields: Fields, axis: str, index: int) -> list[Any]:
        number, field = AXES.index(axis), fields.truth
        place = field.origin_cm[number] + index * field.voxel_size_cm
        words = f"Plane {axis} = {place:.2f} cm, voxel {index} of 0 to {FIELD_SIZE - 1}."
        pictures = self.explorer.slices(fields, number, int(index))
        return [words, *(gr.update(value=one, visible=one is not None) for one in pictures)]

    def _extremes(self, split: str, method: str | None, metric: str | None) -> list[Any]:
        row = self._row(split, method)
        if row is None:
            return [gr.update(visible=False), gr.skip(), gr.skip(), gr.skip()]
        names = [name for name in load_protocol(row["protocol"]).metrics if name in row["metrics"]]
        update, metric = offer([(METRICS[name].heading, name) for name in names], metric)
        headings = ["object", "category", "longest edge, cm", METRICS[metric].heading]
        found = best_and_worst(row, metric, self.results)
        return [gr.update(visible=True), update, *(frame(headings, rows) for rows in found)]


def explore_page(
    explorer: Explorer, entries: Entries, results: Path
) -> tuple[Callable[..., list[Any]], list[Any], list[Any]]:
    """Build the page inside a tab; what is returned is as of the leaderboard's page."""
    page = _Page(explorer, entries, results)
    return page.fill, page.inputs, page.outputs


def object_line(obj: DensityObject) -> str:
    """One line of Markdown on an object: category, source, mass, centre of mass, flags."""
    mass = f"{obj.mass_g:.4g} g" if obj.mass_g == obj.mass_g else "mass unknown"
    weighed = [] if obj.weighed_mass_g is None else [f"weighed {obj.weighed_mass_g:.4g} g"]
    centre = ", ".join(f"{round(float(value), 2) + 0.0:.2f}" for value in obj.com_cm)
    words = [
        f"**{obj.object_id}**",
        obj.category.replace("_", " "),
        f"source **{SOURCES[obj.source]}**",
        mass,
        *weighed,
        f"centre of mass ({centre}) cm",
        *(f"flag {flag}" for flag in obj.flags),
    ]
    return " · ".join(words)
