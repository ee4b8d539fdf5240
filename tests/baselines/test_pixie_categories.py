"""What a network is told of a category: of the others alone, and of a stranger what is usual."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.baselines.pixie_scenes import dataset, prepared
from xden1k.values.modality import Modality
from xden_baselines.pixie.categories import PRIOR_OBJECTS, USUAL, Kind, Peers
from xden_baselines.pixie.store import Stored


@pytest.fixture(scope="module")
def objects(tmp_path_factory: pytest.TempPathFactory) -> list[Stored]:
    folder = dataset(tmp_path_factory.mktemp("categories") / "dataset")
    return prepared(folder, Modality.GEOMETRY | Modality.CATEGORY, 16)


def told(usual: np.ndarray, name: str) -> float:
    return float(usual[USUAL.index(name)])


def test_what_is_told_of_a_category_is_the_mean_of_its_objects(objects: list[Stored]) -> None:
    categories = Peers.of(objects).categories
    assert categories.names == ("bar", "cube", "mug")
    bar, mug = (categories.kind(name).usual for name in ("bar", "mug"))
    overall = np.mean([np.log10(one.overall_g_cm3) for one in objects])
    of_bars = np.log10(objects[0].overall_g_cm3)
    drawn = (2 * of_bars + PRIOR_OBJECTS * overall) / (2 + PRIOR_OBJECTS)
    assert told(bar, "log10_overall") == pytest.approx(drawn, abs=1e-5)
    assert told(bar, "empty_share") < told(mug, "empty_share")
    assert told(bar, "known") == pytest.approx(0.2)
    assert told(bar, "log10_overall_deviation") == pytest.approx(0, abs=1e-6)


def drawn(objects: list[Stored], number: int, times: int = 40) -> list[Kind]:
    peers, rng = Peers.of(objects), np.random.default_rng(0)
    return [peers.drawn(number, rng) for _ in range(times)]


def test_an_object_alone_in_its_category_is_told_what_a_stranger_is(objects: list[Stored]) -> None:
    alone = objects.index(next(one for one in objects if one.category == "cube"))
    unknown = Peers.of(objects).categories.kind("zeppelin")
    for kind in drawn(objects, alone):
        assert told(kind.usual, "known") == 0
        assert np.array_equal(kind.usual, unknown.usual)
        assert kind.index != unknown.index


def test_an_object_is_told_of_some_of_the_others_drawn_anew_each_time(
    objects: list[Stored],
) -> None:
    many = [replace(objects[0], object_id=f"bar-{number}") for number in range(6)]
    known = [round(10 * told(kind.usual, "known")) for kind in drawn([*many, objects[-1]], 0)]
    assert set(known) == {0, 1, 2, 3, 4, 5}


def test_what_an_object_is_told_does_not_follow_its_own_density(objects: list[Stored]) -> None:
    first = objects[0]
    heavy = replace(first, mean_g_cm3=first.mean_g_cm3 * np.float16(10))
    changed = [heavy, *objects[1:]]
    own, other = (
        [
            told(now.usual, "log10_overall") - told(before.usual, "log10_overall")
            for before, now in zip(drawn(objects, number), drawn(changed, number), strict=True)
            if told(now.usual, "known") > 0
        ]
        for number in (0, 1)
    )
    # ten times as dense: 1 in log10, of which the mean over four objects has a quarter
    share = PRIOR_OBJECTS / (1 + PRIOR_OBJECTS)
    assert own == pytest.approx([share / 4] * len(own), abs=1e-3)
    assert other == pytest.approx([1 - share + share / 4] * len(other), abs=1e-3)
    assert own
    assert other


def test_an_unheard_category_is_told_the_mean_of_all(objects: list[Stored]) -> None:
    categories = Peers.of(objects).categories
    kind = categories.kind("zeppelin")
    assert kind.index == 3
    assert told(kind.usual, "known") == 0
    logs = [np.log10(one.overall_g_cm3) for one in objects]
    assert told(kind.usual, "log10_overall") == pytest.approx(np.mean(logs), abs=1e-5)
    assert categories.table.shape == (4, len(USUAL))
