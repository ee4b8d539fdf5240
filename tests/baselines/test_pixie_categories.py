"""What a network is told of a category: of the others alone, and of a stranger what is usual."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.baselines.pixie_scenes import dataset, prepared
from xden1k.values.modality import Modality
from xden_baselines.pixie.categories import PRIOR_OBJECTS, USUAL, Categories
from xden_baselines.pixie.store import Stored


@pytest.fixture(scope="module")
def objects(tmp_path_factory: pytest.TempPathFactory) -> list[Stored]:
    folder = dataset(tmp_path_factory.mktemp("categories") / "dataset")
    return prepared(folder, Modality.GEOMETRY | Modality.CATEGORY, 16)


def told(usual: np.ndarray, name: str) -> float:
    return float(usual[USUAL.index(name)])


def test_what_is_told_of_a_category_is_the_mean_of_its_objects(objects: list[Stored]) -> None:
    categories, _ = Categories.of(objects)
    assert categories.names == ("bar", "cube", "mug")
    bar, mug = (categories.kind(name).usual for name in ("bar", "mug"))
    overall = np.mean([np.log10(one.overall_g_cm3) for one in objects])
    of_bars = np.log10(objects[0].overall_g_cm3)
    drawn = (2 * of_bars + PRIOR_OBJECTS * overall) / (2 + PRIOR_OBJECTS)
    assert told(bar, "log10_overall") == pytest.approx(drawn, abs=1e-5)
    assert told(bar, "empty_share") < told(mug, "empty_share")
    assert told(bar, "known") == pytest.approx(0.2)
    assert told(bar, "log10_overall_deviation") == pytest.approx(0, abs=1e-6)


def test_an_object_is_never_told_of_itself(objects: list[Stored]) -> None:
    _, kinds = Categories.of(objects)
    alone = objects.index(next(one for one in objects if one.category == "cube"))
    assert told(kinds[alone].usual, "known") == 0
    unknown = Categories.of(objects)[0].kind("zeppelin")
    assert np.array_equal(kinds[alone].usual, unknown.usual)
    assert kinds[alone].index != unknown.index


def test_what_an_object_is_told_does_not_follow_its_own_density(objects: list[Stored]) -> None:
    first = objects[0]
    heavy = replace(first, mean_g_cm3=first.mean_g_cm3 * np.float16(10))
    _, kinds = Categories.of(objects)
    _, changed = Categories.of([heavy, *objects[1:]])
    own, other = (
        told(changed[number].usual, "log10_overall") - told(kinds[number].usual, "log10_overall")
        for number in (0, 1)
    )
    # ten times as dense: 1 in log10, of which the mean over four objects has a quarter
    share = PRIOR_OBJECTS / (1 + PRIOR_OBJECTS)
    assert own == pytest.approx(share / 4, abs=1e-3)
    assert other == pytest.approx(1 - share + share / 4, abs=1e-3)


def test_an_unheard_category_is_told_the_mean_of_all(objects: list[Stored]) -> None:
    categories, _ = Categories.of(objects)
    kind = categories.kind("zeppelin")
    assert kind.index == 3
    assert told(kind.usual, "known") == 0
    logs = [np.log10(one.overall_g_cm3) for one in objects]
    assert told(kind.usual, "log10_overall") == pytest.approx(np.mean(logs), abs=1e-5)
    assert categories.table.shape == (4, len(USUAL))
