"""The leaderboard page. Needs the extra ``view``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import gradio as gr

from xden_bench.entries.leaderboard import TRACK_TITLES
from xden_bench.scoring.metrics import METRICS
from xden_bench.serve import board
from xden_bench.serve.figures import interval_picture
from xden_bench.serve.told import GRID, PICTURE, PRIVATE, frame, offer, told

__all__ = ["board_page"]

READING: Final = (
    "Means over objects, ↓ lower is better, ↑ higher is better, with 95 % bootstrap intervals. "
    "A rank is one more than the number of rows that are better beyond doubt: the 95 % interval of "
    "the difference on the same objects excludes zero. Rows that cannot be told apart share a rank "
    "(tie =); trivial rows are never ranked. Source **phantom** means "
    "simulated objects, never on a scanner, **published** the authors' release with densities "
    "estimated by this project. The menu ⋮ of a heading sorts; click on a row to see "
    "how it was made."
)
NOTHING: Final = "No entries yet. The first one can be sent on the page *Submit*."
ASK: Final = "# click on a row of the table"


def board_page(
    entries: Callable[[], tuple[dict[str, Any], ...]], results: Path
) -> tuple[Callable[..., list[Any]], list[Any], list[Any]]:
    """Build the page inside a tab.

    Parameters
    ----------
    entries
        Every entry, as of now.
    results
        Their folder, for the commands.

    Returns
    -------
    tuple
        The function that fills the page, its inputs and its outputs.
    """
    with gr.Row():
        table = gr.Dropdown(label="Table", info="source, split, target, dataset, protocol", scale=2)
        track = gr.Dropdown(label="Track", info="what a method may look at")
        metric = gr.Dropdown(label="Metric", info="sorts the table, fills the chart")
    nothing = gr.Markdown(NOTHING, visible=False)
    with gr.Column() as shown:
        gr.Markdown(READING, elem_classes="note")
        grid = gr.Dataframe(elem_id="board", show_label=False, **GRID)
        chart = gr.Image(elem_id="chart", **PICTURE)
        made = gr.Code(ASK, label="How the row is remade", language="shell", elem_id="made")
        facts = gr.Dataframe(
            elem_id="facts", headers=["of the row", ""], show_label=False, wrap=True, **GRID
        )
        by_category = gr.Dataframe(label="By category", elem_id="by_category", **GRID)
        by_size = gr.Dataframe(label="By size of the object", elem_id="by_size", **GRID)

    @told
    def fill(title: str | None, name: str | None, chosen: str | None) -> list[Any]:
        found = board.boards(entries())
        titles, title = offer(list(found), title)
        tracks = found.get(title, {})
        names, name = offer([(f"{one}: {TRACK_TITLES[one]}", one) for one in tracks], name)
        rows = tracks.get(name, ())
        metrics, chosen = offer(board.metric_choices(rows) if rows else [], chosen)
        heads = [titles, names, metrics, gr.update(visible=bool(rows))]
        heads.append(gr.update(visible=not rows))
        if not rows:
            return [*heads, frame([], []), None, frame([], []), frame([], [])]
        ordered = board.best_first(rows, chosen)
        marks = [board.trivial(row) for row in ordered]
        return [
            *heads,
            frame(*board.board_table(rows, chosen)),
            interval_picture(ordered, chosen, METRICS[chosen].heading, marks),
            frame(*board.group_table(rows, chosen, "category")),
            frame(*board.group_table(rows, chosen, "size")),
        ]

    @told
    def pick(title: str | None, name: str | None, event: gr.SelectData) -> list[Any]:
        rows = board.boards(entries()).get(title or "", {}).get(name or "", ())
        row = board.entry_at(rows, event.row_value)
        return [ASK, []] if row is None else [board.how_made(row, results), board.facts(row)]

    inputs = [table, track, metric]
    outputs = [*inputs, shown, nothing, grid, chart, by_category, by_size]
    gr.on([one.input for one in inputs], fill, inputs, outputs, **PRIVATE)
    grid.select(pick, [table, track], [made, facts], **PRIVATE)
    return fill, inputs, outputs
