"""The object explorer's page. Needs the extras ``view`` and ``build``."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, Final

import gradio as gr
import numpy as np
from fastapi import FastAPI

from xden1k.export.si import M_PER_CM
from xden1k.values.types import FIELD_SIZE
from xden_bench.scoring.metrics import METRICS
from xden_bench.scoring.protocol import load_rules
from xden_bench.serve.app import OBJECTS
from xden_bench.serve.explorer import COLOURS, PART_HEADINGS, Explorer, Fields, best_and_worst
from xden_bench.serve.figures import AXES
from xden_bench.serve.standings import Standings
from xden_bench.serve.told import GRID, PRIVATE, frame, offer, told
from xden_bench.serve.words import object_line

__all__ = ["mount_explorer"]

NO_METHOD: Final = "none: the truth alone"
RADIOGRAPHS: Final = (
    "### Radiographs\n\nThe reprojection is of the dataset's own parts: exact path lengths through "
    "their meshes with the stored attenuation and geometry, one coefficient for each part. It is "
    "not of the chosen method: a density says nothing of attenuation without the material. Objects "
    "of the authors' release have no radiographs, and none are drawn."
)
SLICES: Final = (
    "### Slices\n\nVoxel means. Blank: outside the outer surface, where nothing is scored. Truth "
    "and prediction share one colour scale, that of the whole object."
)
CLEAR: Final = (0.0, 0.0, 0.0, 0.0)
VIEW_DEGREES: Final = (60, 65)
"""Of the camera: around the object, and down from the vertical."""
VIEW_DISTANCE: Final = 1.5
"""Of the camera, in diagonals of the object."""


HEADER: Final = (
    '<header class="site"><p>XDen-1K benchmark</p><nav aria-label="Pages">'
    '<a href="/board">Leaderboard</a><a href="/objects/" aria-current="page">Objects</a>'
    '<a href="/submit">Submit</a></nav></header>'
)
AT_ONCE: Final = 4
"""Events answered at the same time."""
STYLE: Final = """<style>
.gradio-container {
  width: 100%; min-width: 0; max-width: min(1280px, 100vw) !important; margin: auto;
  box-sizing: border-box; overflow-x: clip;
}
.gradio-container, .gradio-container * {
  --block-info-text-color: var(--body-text-color); --block-label-text-color: var(--body-text-color);
  --block-title-text-color: var(--body-text-color);
}
.gradio-container .column, .gradio-container .block, .gradio-container .form { min-width: 0 }
.gradio-container input { text-overflow: ellipsis }
header.site { display: flex; flex-wrap: wrap; gap: 0.25rem 2rem; align-items: baseline }
header.site p { margin: 0; font-weight: 650 }
header.site a { padding: 0.35rem 0; margin-right: 1.25rem; text-decoration: underline }
header.site a[aria-current] { font-weight: 650; text-decoration: none }
.note { font-size: 0.92em }
.pictures { display: grid !important; gap: 0.5rem;
  grid-template-columns: repeat(auto-fit, minmax(min(300px, 100%), 1fr)) }
.pictures > .hide, .pictures > .hidden { display: none }
.picture svg { width: 100%; max-width: 420px; height: auto; display: block;
  color: var(--body-text-color) }
#parts td { overflow-wrap: anywhere }
@media (hover: none) {
  .header-cell .cell-menu-button { display: flex !important }
  .header-cell .cell-wrap { padding-right: 2em }
}
@media (max-width: 640px) {
  .gradio-container .row, .gradio-container .form { flex-direction: column }
  .gradio-container .row > * { width: 100%; min-width: 0 !important }
  .gradio-container { padding: 6px !important }
  .gradio-container table { font-size: 0.82em }
}
</style>"""


class _Page:
    """The components and the answers to their events."""

    def __init__(self, explorer: Explorer, standings: Standings) -> None:
        self.explorer, self.standings = explorer, standings
        gr.HTML(HEADER)
        gr.Markdown("# Objects")
        with gr.Row():
            self.split = gr.Dropdown(label="Split", min_width=110, scale=1)
            self.object = gr.Dropdown(label="Object", elem_id="object", scale=3)
            self.method = gr.Dropdown(label="Method", elem_id="method", scale=4)
        self.line = gr.Markdown(elem_id="line", elem_classes="note")
        with gr.Row():
            with gr.Column(scale=1, min_width=330):
                self.model = gr.Model3D(
                    label="Parts in 3D", height=420, elem_id="model", clear_color=CLEAR
                )
                self.bar = _picture("bar")
                with gr.Row():
                    self.colour = gr.Radio(
                        COLOURS, value="density", label="Coloured by", scale=2, elem_id="colour"
                    )
                    self.cut = gr.Checkbox(
                        label="Cut open", info="without its front half", elem_id="cut"
                    )
            with gr.Column(scale=1, min_width=330):
                self.parts = gr.Dataframe(label="Parts", elem_id="parts", **GRID)
        self._slices_part()
        gr.Markdown(RADIOGRAPHS)
        self.radiographs = []
        for view in ("PA", "LAT"):
            with gr.Row(elem_classes="pictures"):
                self.radiographs += [_picture(f"{view}-{place}") for place in range(3)]
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
        with gr.Row(elem_classes="pictures"):
            self.slices = [_picture(f"slice-{name}") for name in ("truth", "prediction", "error")]

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
        for choice in self.chosen:
            self.refill_on(choice.input)
        for how in (self.colour, self.cut):
            how.input(**self._model_event)
        gr.on([self.axis.input, self.index.change], **self._slices_event)
        self.metric.input(
            self.list_extremes,
            [self.split, self.method, self.metric],
            self._extreme_outputs,
            **PRIVATE,
        )
        for table in (self.best, self.worst):
            self.refill_on(table.select(self.open_row, None, self.object, **PRIVATE).then)

    def refill_on(self, trigger: Callable[..., Any]) -> None:
        """Fill the page when something happens: words and tables first, then each picture.

        What is drawn later sees the choices as they are then, so that no picture of an older
        choice comes last.
        """
        filled = trigger(
            self.fill,
            [*self.chosen, self.metric],
            [*self.chosen, self.line, self.parts, *self._extreme_outputs],
            **PRIVATE,
        )
        filled.then(**self._model_event)
        filled.then(**self._slices_event)
        filled.then(self.draw_radiographs, self.object, self.radiographs, **PRIVATE)

    @property
    def chosen(self) -> list[Any]:
        """What says which fields are shown."""
        return [self.split, self.object, self.method]

    @property
    def _extreme_outputs(self) -> list[Any]:
        return [self.extremes, self.metric, self.best, self.worst]

    @property
    def _model_event(self) -> dict[str, Any]:
        return {
            "fn": self.draw_model,
            "inputs": [*self.chosen, self.colour, self.cut],
            "outputs": [self.model, self.bar],
            "trigger_mode": "always_last",
            **PRIVATE,
        }

    @property
    def _slices_event(self) -> dict[str, Any]:
        return {
            "fn": self.draw_slices,
            "inputs": [*self.chosen, self.axis, self.index],
            "outputs": [self.place, *self.slices],
            "trigger_mode": "always_last",
            "show_progress": "hidden",
            **PRIVATE,
        }

    @told
    def fill(
        self,
        split: str | None,
        object_id: str | None,
        method: str | None,
        metric: str | None,
    ) -> list[Any]:
        splits, split = offer(self.explorer.splits, split)
        objects, object_id = offer(self.explorer.folder.ids(split), object_id)
        methods, method = offer(self._labels(split), method)
        fields = self._fields(split, object_id, method)
        return [
            *(splits, objects, methods),
            object_line(fields.obj) + self._missing_note(fields, method),
            frame(PART_HEADINGS, self.explorer.parts(object_id)),
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
    def draw_radiographs(self, object_id: str) -> list[Any]:
        pictures = self.explorer.radiographs(object_id)
        shown = [gr.update(value=one, visible=True) for one in pictures]
        return shown or [gr.update(value=None, visible=False)] * len(self.radiographs)

    @told
    def list_extremes(self, split: str, method: str, metric: str) -> list[Any]:
        return self._extremes(split, method, metric)

    @told
    def open_row(self, event: gr.SelectData) -> Any:
        return event.row_value[0] if event.row_value else gr.skip()

    def _labels(self, split: str) -> list[str]:
        """Methods whose files are at hand, then none, then the others."""
        rows = self.explorer.methods(self.standings.now.entries, split)
        stored = [label for label, row in rows.items() if self.explorer.stored(row)]
        return [*stored, NO_METHOD, *(label for label in rows if label not in stored)]

    def _row(self, split: str, method: str | None) -> Any:
        return self.explorer.methods(self.standings.now.entries, split).get(method or "")

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
        names = [name for name in load_rules(row["protocol"]).metrics if name in row["metrics"]]
        update, metric = offer([(METRICS[name].heading, name) for name in names], metric)
        headings = ["object", "category", "longest edge, cm", METRICS[metric].heading]
        found = best_and_worst(row, metric, self.standings.results)
        return [gr.update(visible=True), update, *(frame(headings, rows) for rows in found)]


def mount_explorer(app: FastAPI, explorer: Explorer, standings: Standings) -> None:
    """Put the page beside the others.

    Parameters
    ----------
    app
        From :func:`xden_bench.serve.app.build_app`.
    explorer
        Has the objects.
    standings
        Has the entries, and knows where their objects lie.
    """
    os.environ["GRADIO_ANALYTICS_ENABLED"] = "False"
    blocks = gr.Blocks(title="Objects · XDen-1K benchmark", analytics_enabled=False)
    with blocks:
        page = _Page(explorer, standings)
        page.refill_on(blocks.load)
    blocks.queue(api_open=False, default_concurrency_limit=AT_ONCE)
    gr.mount_gradio_app(
        app,
        blocks,
        OBJECTS,
        footer_links=[],
        ssr_mode=False,
        theme=gr.themes.Default(
            font=["system-ui", "sans-serif"], font_mono=["ui-monospace", "monospace"]
        ),
        head=STYLE,
    )


def _picture(elem_id: str) -> gr.HTML:
    return gr.HTML(elem_id=elem_id, elem_classes="picture", min_width=300)
