"""The official dataset: drawn by its rule, made as its recipe says, compared column by column."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from tests.phantoms import BAR, CUBE, box_object
from xden1k.access.hub import SAMPLE
from xden1k.errors import DataError, MissingExtraError
from xden1k.folder import DatasetFolder, open_folder, write_folder
from xden1k.folder.verify import verify_folder
from xden_bench.cli import cli
from xden_bench.datasets import DATASETS, differences, draw_unseen, load_recipe, making
from xden_bench.datasets import __main__ as publishing
from xden_bench.datasets.fingerprints import write_fingerprints
from xden_builder.phantoms import CATALOGUE, plan_objects

NAMES = [category.name for category in CATALOGUE]


@pytest.mark.parametrize("name", DATASETS)
def test_unseen_categories_are_those_of_the_rule(name: str) -> None:
    unseen = load_recipe(name).unseen
    assert unseen == draw_unseen(name, NAMES, 30)
    families = {category.family for category in CATALOGUE if category.name in unseen}
    assert families == {category.family for category in CATALOGUE}


@pytest.mark.parametrize("name", DATASETS)
def test_splits_are_those_of_the_recipe_and_no_unseen_category_is_in_another(name: str) -> None:
    recipe = load_recipe(name)
    plans = plan_objects(recipe.settings["count"], recipe.settings["seed"], unseen=recipe.unseen)
    assert Counter(plan.split for plan in plans) == recipe.splits
    assert {plan.category.name for plan in plans if plan.split == "unseen"} == set(recipe.unseen)
    seen = {plan.category.name for plan in plans if plan.split != "unseen"}
    assert seen == set(NAMES) - set(recipe.unseen)


def test_a_misspelt_dataset_is_told_with_the_right_name() -> None:
    with pytest.raises(DataError, match=r"no dataset 'XDen-P200'; there are XDen-P2000"):
        load_recipe("XDen-P200")


def test_a_missing_maker_says_which_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(making, "entry_points", lambda group: ())
    with pytest.raises(MissingExtraError, match=r"needs the maker phantoms.*\[build\]"):
        making.make_dataset(load_recipe("XDen-P2000"), tmp_path / "out", workers=1)


def written(root: Path, *objects: object) -> DatasetFolder:
    write_folder(objects, root, version="0.1.0", builder="tests")  # type: ignore[arg-type]
    return open_folder(root)


def test_what_differs_is_told_by_object_and_column(tmp_path: Path) -> None:
    one, other = box_object("a-0001", BAR), box_object("b-0001", CUBE)
    parts = tuple(replace(part, density_g_cm3=1.01 * part.density_g_cm3) for part in other.parts)
    density = replace(other.density, density_g_cm3=1.01 * other.density.density_g_cm3)
    published = written(tmp_path / "published", one, other)
    write_fingerprints(published, tmp_path / "sums.parquet")
    assert differences(published, tmp_path / "sums.parquet") == ()
    changed = written(tmp_path / "changed", one, replace(other, parts=parts, density=density))
    found = {each.column: each for each in differences(changed, tmp_path / "sums.parquet")}
    assert {"density", "mass_g", "part_density_g_cm3"} <= found.keys()
    assert found.keys().isdisjoint({"envelope", "xray_pa", "mesh_vertices"})
    assert {each.object_ids for each in found.values()} == {("b-0001",)}
    assert found["density"].is_scored
    assert found["density"].largest > 0
    assert str(found["mass_g"]) == "mass_g differs in b-0001"


def test_an_object_of_another_dataset_is_refused(tmp_path: Path) -> None:
    write_fingerprints(written(tmp_path / "one", box_object("a-0001", BAR)), tmp_path / "sums")
    strange = written(tmp_path / "two", box_object("b-0001", BAR))
    with pytest.raises(DataError, match="b-0001 is not in the published dataset"):
        differences(strange, tmp_path / "sums")


def test_verify_tells_an_unseen_category_in_another_split(tmp_path: Path) -> None:
    split = {"a-0001": "train", "a-0002": "unseen", "b-0001": "unseen"}
    objects = [box_object(name, BAR, split=split[name], category=name[0]) for name in split]
    written(tmp_path / "leaking", *objects)
    problems = verify_folder(tmp_path / "leaking")
    assert problems == ["categories of the split unseen are in train too: a"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "give --out ROOT, or --from-hub"),
        (["--out", "o", "--objects", "3"], "expected FIRST-LAST, such as 0-39, got '3'"),
        (["--out", "o", "--from-hub", "a/b@v1"], "no --out, --objects"),
    ],
)
def test_a_wrong_call_makes_nothing(
    words: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(cli, ["dataset", "XDen-P2000", *words])
    assert (done.exit_code, list(tmp_path.iterdir())) == (2, [])
    assert message in " ".join(done.stderr.split())


def test_scores_of_the_sample_are_no_entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDEN1K_ROOT", str(SAMPLE))
    assert CliRunner().invoke(cli, ["baseline", "zero"]).exit_code == 0
    refused = CliRunner().invoke(cli, ["submit", "zero.npz"])
    assert refused.exit_code == 1
    assert "6 objects of the packaged sample are no entry of the leaderboard" in refused.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["zero.npz"]
    own = CliRunner().invoke(cli, ["submit", "zero.npz", "--out", "own"])
    assert own.exit_code == 0
    assert f"split test of {SAMPLE}\nno rank in track geometry: trivial\n" in own.stdout


@pytest.mark.slow
def test_the_command_makes_verifies_and_says_what_came(tmp_path: Path) -> None:
    out = tmp_path / "few"
    words = ["dataset", "XDen-P2000", "--out", str(out), "--objects", "0-1", "--workers", "1"]
    done = CliRunner().invoke(cli, [*words, "--json"])
    assert done.exit_code == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["manifest_sha256"] == open_folder(out).manifest_sha256
    assert told["differences"] == []
    assert "2 objects" in done.stderr
    assert list((tmp_path / "few.work").iterdir()) == [tmp_path / "few.work" / "run.lock"]


@pytest.mark.parametrize("place", [271, 1536], ids=["caster-0007", "spirit_level-0006"])
def test_an_object_with_a_splinter_is_the_published_one_to_the_byte(
    tmp_path: Path, place: int
) -> None:
    """Cuts have left splinters in 14 of the 2,000; whoever drops them makes another dataset."""
    out = tmp_path / "one"
    words = ["--out", str(out), "--objects", f"{place}-{place}", "--workers", "1", "--json"]
    done = CliRunner().invoke(cli, ["dataset", "XDen-P2000", *words])
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["differences"] == []


def test_only_a_whole_dataset_is_published_and_only_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = written(tmp_path / "made", box_object("a-0001", BAR, split="test"))
    few = replace(load_recipe("XDen-P2000"), splits={"test": 1})
    (tmp_path / "XDen-P2000.toml").write_text(f"{publishing.UNKNOWN}\n")
    with pytest.raises(DataError, match=r"expected {'train': 1093.*got {'test': 1}"):
        publishing.publish("XDen-P2000", tmp_path / "made", tmp_path)
    monkeypatch.setattr(publishing, "load_recipe", lambda _: few)
    publishing.publish("XDen-P2000", tmp_path / "made", tmp_path)
    assert folder.manifest_sha256 in (tmp_path / "XDen-P2000.toml").read_text()
    assert differences(folder, tmp_path / "XDen-P2000.parquet") == ()
    with pytest.raises(DataError, match="is published already"):
        publishing.publish("XDen-P2000", tmp_path / "made", tmp_path)
