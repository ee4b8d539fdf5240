"""xden-bench as a user meets it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fsspec
import numpy as np
import pytest
from click.testing import CliRunner, Result

from xden1k.access import hub
from xden1k.values.modality import TRACKS
from xden_bench.cli import cli
from xden_bench.commands.segments import segment
from xden_bench.scoring.protocol import PROTOCOLS

Submit = Callable[..., Path]


@pytest.fixture
def run(dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Result]:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDEN1K_ROOT", str(dataset))
    return lambda *words: CliRunner().invoke(cli, [str(word) for word in words])


def files(folder: Path) -> list[str]:
    return sorted(one.relative_to(folder).as_posix() for one in folder.rglob("*") if one.is_file())


def test_from_a_baseline_to_a_row(run: Callable[..., Result], tmp_path: Path) -> None:
    for name in ("water", "category-median"):
        assert run("baseline", name).exit_code == 0
        assert run("validate", f"{name}.npz").exit_code == 0
        assert run("submit", f"{name}.npz").exit_code == 0
    made = run("leaderboard")
    assert made.exit_code == 0
    assert made.stdout.endswith("LEADERBOARD.md: 2 entries\n")
    text = (tmp_path / "LEADERBOARD.md").read_text()
    for name in ("water", "category-median"):
        assert f"| *{name}*" in text
        assert f"`xden-bench baseline {name}`, then `xden-bench submit {name}.npz`" in text
    assert run("leaderboard", "--check").stdout == "LEADERBOARD.md: 2 entries, up to date\n"


def test_the_check_fails_after_a_new_entry(run: Callable[..., Result]) -> None:
    for name in ("zero", "water"):
        run("baseline", name)
        run("submit", f"{name}.npz")
        if name == "zero":
            assert run("leaderboard").exit_code == 0
    checked = run("leaderboard", "--check")
    assert checked.exit_code == 1
    assert checked.stderr == (
        "Error: LEADERBOARD.md does not match the results: run xden-bench leaderboard\n"
    )


def test_the_same_command_gives_the_same_predictions_and_facts(
    run: Callable[..., Result], tmp_path: Path
) -> None:
    run("baseline", "category-median")
    first = dict(np.load(tmp_path / "category-median.npz"))
    run("baseline", "category-median")
    second = dict(np.load(tmp_path / "category-median.npz"))
    facts = [json.loads(str(one.pop("__meta__"))) for one in (first, second)]
    for measured in ("seconds_per_object", "processor_seconds_per_object", "peak_memory_gb"):
        assert facts[0].pop(measured) > 0 < facts[1].pop(measured)
    assert facts[0] == facts[1]
    assert {name: grid.tobytes() for name, grid in first.items()} == {
        name: grid.tobytes() for name, grid in second.items()
    }


@pytest.mark.parametrize("command", ["validate", "score", "submit"])
def test_nothing_is_written_on_a_bad_submission(
    run: Callable[..., Result], submission: Submit, tmp_path: Path, command: str
) -> None:
    path = submission(lambda one, grid: None if one == "bar-0002" else grid, split="val")
    before = files(tmp_path)
    done = run(command, path)
    assert done.exit_code == 1
    assert done.stdout == ""
    assert done.stderr.splitlines()[:2] == [
        "Error: E205: split must be 'test' here, got 'val'",
        "E301: objects missing of the 4 in the split test: 1: 'bar-0002'",
    ]
    assert files(tmp_path) == before


def missing(arrays: dict[str, Any]) -> None:
    del arrays["density/bar-0002"]


def extra(arrays: dict[str, Any]) -> None:
    arrays["density/mug-0001"] = arrays["density/bar-0002"]


def not_finite(arrays: dict[str, Any]) -> None:
    arrays["density/bar-0002"][3, 4, 5] = np.nan


def negative(arrays: dict[str, Any]) -> None:
    arrays["density/bar-0002"][3, 4, 5] = -1


def wrong_shape(arrays: dict[str, Any]) -> None:
    arrays["density/bar-0002"] = arrays["density/bar-0002"][:32]


def pickled(arrays: dict[str, Any]) -> None:
    arrays["density/bar-0002"] = np.array([{}], dtype=object)


@pytest.mark.parametrize(
    ("spoil", "line"),
    [
        (missing, "E301: objects missing of the 4 in the split test: 1: 'bar-0002'"),
        (not_finite, "E403 bar-0002: 1 values are not finite, first at (3, 4, 5)"),
        (pickled, "E103 bar-0002: an object array, which would have to be unpickled"),
        *(
            pytest.param(*one, marks=pytest.mark.slow)
            for one in (
                (extra, "E302: objects that are none of the 4 in the split test: 1: 'mug-0001'"),
                (negative, "E404 bar-0002: 1 values are negative, first at (3, 4, 5)"),
                (wrong_shape, "E402 bar-0002: shape must be (64, 64, 64), got (32, 64, 64)"),
            )
        ),
    ],
)
def test_one_flaw_is_one_line(
    run: Callable[..., Result],
    submission: Submit,
    tmp_path: Path,
    spoil: Callable[[dict[str, Any]], None],
    line: str,
) -> None:
    with np.load(submission(lambda _, grid: np.float32(1.1) * grid)) as sound:
        arrays = dict(sound)
    spoil(arrays)
    np.savez(tmp_path / "preds.npz", **arrays)
    done = run("submit", "preds.npz")
    assert (done.exit_code, done.stderr) == (1, f"Error: {line}\n")
    assert files(tmp_path) == ["preds.npz"]


def test_validate_as_json(run: Callable[..., Result], submission: Submit, tmp_path: Path) -> None:
    path = submission(lambda one, grid: None if one == "bar-0002" else grid)
    done = run("validate", path, "--json", "--out", "report.json")
    assert done.exit_code == 1
    report = json.loads(done.stdout)
    assert report == json.loads((tmp_path / "report.json").read_text())
    assert report["valid"] is False
    assert [one["code"] for one in report["problems"]] == ["E301", "W504"]
    sound = run("validate", submission(), "--json")
    assert sound.exit_code == 0
    assert json.loads(sound.stdout)["valid"] is True


def test_score_as_json_and_to_a_file(
    run: Callable[..., Result], submission: Submit, tmp_path: Path
) -> None:
    done = run("score", submission(), "--json", "--out", "score.json")
    assert done.exit_code == 0
    entry = json.loads(done.stdout)
    assert entry == json.loads((tmp_path / "score.json").read_text())
    assert entry["metrics"]["mass_mape"] == {"mean": 0.0, "macro_mean": 0.0, "ci95": None}
    assert not (tmp_path / "benchmarks").exists()


def test_score_prints_every_metric(run: Callable[..., Result], submission: Submit) -> None:
    text = run("score", submission()).stdout
    for title in ("density MAE, g/cm³ ↓", "CoM L1, cm ↓", "mass MnRE ↑", "inertia error ↓"):
        assert title in text
    assert "W504: the values of the reference, within " in text
    assert "under 8 cm" in text
    assert "hollow" in text


def test_a_folder_at_a_url_scores_like_the_folder(
    run: Callable[..., Result], submission: Submit, dataset: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "cache")
    fs = fsspec.filesystem("memory")
    fs.put(f"{dataset}/", "/scored", recursive=True)
    there = run("score", submission(), "--root", "memory://scored", "--json")
    fs.rm("/scored", recursive=True)
    assert (
        json.loads(there.stdout)["metrics"]
        == json.loads(run("score", submission(), "--json").stdout)["metrics"]
    )


def test_submit_says_which_rank_it_got_and_why_it_got_none(
    run: Callable[..., Result], submission: Submit
) -> None:
    for name, factor in (("far", 3.0), ("near", 1.5)):
        file = submission(lambda _, grid, by=factor: np.float32(by) * grid, method=name)
        said = run("submit", file).stdout
    assert "\nrank 1= of 2 in track geometry\n" in said  # too few objects to tell
    said = run("submit", submission(method="copied")).stdout
    assert "\nno rank in track geometry: its values are those of the reference\n" in said
    run("baseline", "water")
    assert "\nno rank in track geometry: trivial\n" in run("submit", "water.npz").stdout


def test_every_seed_of_a_method_is_told_the_rank_of_its_one_row(
    run: Callable[..., Result], submission: Submit
) -> None:
    for seed in (2, 1, 0):
        factor = 1.3 + 0.1 * seed
        file = submission(lambda _, grid, by=factor: np.float32(by) * grid, seed=seed)
        assert "\nrank 1 of 1 in track geometry\n" in run("submit", file).stdout


def test_a_protocol_without_ranks_is_named_where_a_rank_is_missing(
    run: Callable[..., Result], submission: Submit
) -> None:
    file = submission(lambda _, grid: np.float32(1.5) * grid)
    said = run("submit", file, "--protocol", "v1").stdout
    assert "\nno rank in track geometry: protocol v1 has no ranks\n" in said


def test_submit_tells_where(run: Callable[..., Result], submission: Submit, tmp_path: Path) -> None:
    done = json.loads(run("submit", submission(), "--json", "--out", "results").stdout)
    assert (tmp_path / done["file"]).is_file()
    again = run("submit", submission(), "--out", "results")
    assert again.exit_code == 1
    assert "entered already" in again.stderr


def test_the_command_is_kept_as_given(run: Callable[..., Result], submission: Submit) -> None:
    submission(name="a b.npz")
    done = run("submit", "a b.npz", "--track", "geometry", "--json")
    assert json.loads(done.stdout)["command"] == "xden-bench submit 'a b.npz' --track geometry"


def test_baselines_are_listed(run: Callable[..., Result]) -> None:
    names = {one["name"]: one for one in json.loads(run("baseline", "--list", "--json").stdout)}
    assert {"zero", "water", "train-median", "category-median"} <= names.keys()
    assert names["water"]["track"] == "geometry"
    assert "water" in run("baseline", "--list").stdout


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["baseline", "nope"], 1, "no method 'nope' is installed; xden-bench baseline --list"),
        (["baseline", "pixie"], 1, "no method 'pixie' is installed; did you mean pixie-style"),
        (["baseline"], 2, "Give the NAME of a method, or --list."),
        (["baseline", "water", "--split", "nope"], 1, "no split 'nope'"),
        (["score", "nope.npz"], 1, "Error: nope.npz: No such file or directory"),
        (["score", "nope.npz", "--root", "."], 1, "is not a dataset folder"),
        (["score", "nope.npz", "--track", "sonar"], 2, "'sonar' is not one of"),
        (["leaderboard", "--check", "--by", "size"], 2, "Of --check, --by and --eval-results"),
        (["leaderboard", "--metric", "mass_mape"], 2, "The option --metric goes with --by."),
        (["compare", "nope.npz", "nope.json"], 1, "Error: nope.npz: No such file or directory"),
        (["verify", "nope.json"], 1, "Error: nope.json: No such file or directory"),
        (["leaderboard", "--check"], 1, "there is no folder of results at benchmarks/results"),
    ],
)
def test_errors_are_one_line(
    run: Callable[..., Result], words: list[str], code: int, message: str, tmp_path: Path
) -> None:
    done = run(*words)
    assert done.exit_code == code
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    if code == 1:
        assert len(done.stderr.splitlines()) == 1
    assert files(tmp_path) == []


@pytest.fixture
def run_sample(
    run: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., Result]:
    """Run where nothing says which dataset is meant, as after an installation."""
    monkeypatch.delenv("XDEN1K_ROOT")
    monkeypatch.setattr(hub, "cache_folder", lambda: tmp_path / "no cache")
    hub._say_that_it_is_the_sample.cache_clear()
    return run


def test_the_sample_is_a_note_not_a_warning_of_pythons(run_sample: Callable[..., Result]) -> None:
    (note,) = run_sample("template").stderr.splitlines()
    assert note.startswith("note: using the small simulated sample of the package")


def test_a_file_that_does_not_fit_the_sample_is_told_that_it_is_the_sample(
    run_sample: Callable[..., Result], submission: Submit
) -> None:
    note, *errors = run_sample("score", submission()).stderr.splitlines()
    assert note.startswith("note: using the small simulated sample of the package")
    assert any("E302" in error for error in errors)


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["score", "nope.npz"], "Error: nope.npz: No such file or directory"),
        (["baseline", "nope"], "Error: no method 'nope' is installed"),
        (["template", "--split", "nope"], "no split 'nope'"),
    ],
)
def test_an_error_that_has_nothing_to_do_with_the_sample_stands_alone(
    run_sample: Callable[..., Result], words: list[str], error: str
) -> None:
    (line,) = run_sample(*words).stderr.splitlines()
    assert error in line


def test_submit_says_what_comes_next(
    run: Callable[..., Result], submission: Submit, tmp_path: Path
) -> None:
    path = submission()
    away = run("submit", path).stdout.splitlines()[-2:]
    assert away[0].startswith(f"entered: {tmp_path}/benchmarks/results/v2/")
    assert "This is no checkout of the repository" in away[1]
    last = run("submit", path, "--out", "my results").stdout.splitlines()[-1]
    assert last == "`xden-bench leaderboard --results 'my results'` makes the table."
    (tmp_path / "benchmarks" / "results" / "README.md").touch()
    other = submission(lambda _, grid: 1.3 * grid, method="other")
    last = run("submit", other).stdout.splitlines()[-1]
    assert last == "`xden-bench leaderboard` makes the table."


@pytest.mark.parametrize("name", [pytest.param("water", marks=pytest.mark.slow), " Water"])
def test_only_water_is_called_water(
    run: Callable[..., Result], submission: Submit, tmp_path: Path, name: str
) -> None:
    path = submission(method=name)
    done = run("submit", path)
    assert done.exit_code == 1
    assert "the name 'water' is that of a trivial method, and its value of bar-0002 is another" in (
        done.stderr
    )
    assert files(tmp_path) == ["preds.npz"]
    run("baseline", "water")
    assert run("submit", "water.npz").exit_code == 0


def entered(run: Callable[..., Result], name: str) -> str:
    """Run a method, submit it, and return the path of its entry."""
    assert run("baseline", name).exit_code == 0
    return str(json.loads(run("submit", f"{name}.npz", "--json").stdout)["file"])


def named(path: Path) -> None:
    """Fill in the name of a template."""
    with np.load(path) as empty:
        arrays = dict(empty)
    meta = json.loads(str(arrays["__meta__"])) | {"method": "named"}
    np.savez_compressed(path, **arrays | {"__meta__": np.array(json.dumps(meta))})


def test_a_template_says_what_to_fill_in_and_is_refused_until_it_is(
    run: Callable[..., Result], tmp_path: Path
) -> None:
    said = run("template", "--track", "xray", "--out", "mine.npz").stdout
    assert said.startswith("mine.npz: 4 objects of zeros, target density. Fill in:\n")
    for name in ("density/ID", "density_sd/ID", "method", "inputs", "training_data"):
        assert f"  {name}: " in said
    refused = run("validate", "mine.npz", "--track", "xray")
    assert (refused.exit_code, refused.stderr.count("E")) == (1, 2)
    assert "E207: method is still 'my method'" in refused.stderr
    named(tmp_path / "mine.npz")
    assert run("validate", "mine.npz", "--track", "xray").exit_code == 0
    assert run("validate", "mine.npz", "--track", "rgb").exit_code == 1
    made = json.loads(run("template", "--protocol", "paper", "--json").stdout)
    assert made["meta"]["target"] == "apparent_density"
    assert made["ids"] == ["bar-0002", "cube-0003", "filled-0001", "hollow-0002"]
    named(tmp_path / "preds.npz")
    assert run("validate", "preds.npz", "--protocol", "paper").exit_code == 0
    filled_in = (tmp_path / "preds.npz").read_bytes()
    refused = run("template")
    assert refused.exit_code == 1
    assert "preds.npz is there, and may be filled in: name another by --out" in refused.stderr
    assert (tmp_path / "preds.npz").read_bytes() == filled_in
    assert run("template", "--force").exit_code == 0
    assert (tmp_path / "preds.npz").read_bytes() != filled_in


@pytest.mark.parametrize(
    "track", [*(pytest.param(one, marks=pytest.mark.slow) for one in TRACKS[:-1]), TRACKS[-1]]
)
def test_a_template_enters_the_track_it_was_made_for(
    run: Callable[..., Result], track: str, tmp_path: Path
) -> None:
    run("template", "--track", track)
    named(tmp_path / "preds.npz")
    assert run("score", "preds.npz", "--track", track).exit_code == 0


@pytest.mark.parametrize("command", ["validate", "score", "submit"])
def test_what_looks_like_a_slip_is_refused_unless_it_is_meant(
    run: Callable[..., Result], tmp_path: Path, command: str
) -> None:
    run("baseline", "water")
    with np.load(tmp_path / "water.npz") as found:
        arrays = {name: found[name] for name in found}
    meta = json.loads(str(arrays.pop("__meta__"))) | {"method": "light", "units": "kg/m3"}
    np.savez_compressed(tmp_path / "light.npz", __meta__=np.array(json.dumps(meta)), **arrays)
    out = ["--out", "out"] if command == "submit" else []
    refused = run(command, "light.npz", *out)
    assert refused.exit_code == 1
    (line,) = refused.stderr.splitlines()
    assert line.startswith("Error: W501: kg/m3 declared, but the highest value is 1")
    assert line.endswith("(if it is meant: --accept-warnings)")
    assert not (tmp_path / "out").exists()
    meant = run(command, "light.npz", *out, "--accept-warnings")
    assert meant.exit_code == 0
    assert "W501" in meant.stdout


def test_an_edited_template_is_a_submission(run: Callable[..., Result], tmp_path: Path) -> None:
    run("template")
    with np.load(tmp_path / "preds.npz") as empty:
        arrays = dict(empty)
    meta = json.loads(str(arrays["__meta__"])) | {"method": "edited"}
    arrays["__meta__"] = np.array(json.dumps(meta))
    for name in arrays:
        if name != "__meta__":
            arrays[name] += np.float32(2)
    np.savez_compressed(tmp_path / "preds.npz", **arrays)
    entry = json.loads(run("submit", "preds.npz", "--json").stdout)
    assert entry["method"]["name"] == "edited"
    assert entry["metrics"]["mass_mape"]["mean"] < 1


def test_the_papers_rules_by_option(run: Callable[..., Result]) -> None:
    run("baseline", "water", "--target", "apparent_density")
    entry = json.loads(run("submit", "water.npz", "--protocol", "paper", "--json").stdout)
    assert entry["command"] == "xden-bench submit water.npz --protocol paper"
    assert entry["protocol"] == "paper"
    assert list(entry["metrics"]) == ["density_mae_g_cm3", "com_l1_cm", "mass_mape"]
    assert "/results/paper/" in entry["file"]
    refused = run("score", "water.npz", "--protocol", "v0")
    assert refused.exit_code == 2
    assert "'v0' is not one of " + ", ".join(map(repr, PROTOCOLS)) in refused.stderr


def test_compare_takes_submissions_and_entries(run: Callable[..., Result]) -> None:
    water = entered(run, "water")
    run("baseline", "zero")
    text = run("compare", water, "zero.npz").stdout
    assert text.startswith("a: water\nb: zero\nmetric ")
    assert re.search(r"mass MAPE ↓ +-0\.5528 +- +0\.125 +4 : 0", text)
    found = json.loads(run("compare", "zero.npz", water, "--json", "--largest", "1").stdout)
    assert (found["a"], found["b"], found["split"]) == ("zero", "water", "test")
    mape = found["metrics"]["mass_mape"]
    assert (mape["p_equal"], mape["a_better"], mape["b_better"]) == (0.125, 0, 4)
    assert len(mape["largest"]) == 1
    run("baseline", "water", "--target", "apparent_density", "--out", "other.npz")
    refused = run("compare", water, "other.npz")
    assert refused.exit_code == 1
    assert "only scores of one target can be compared" in refused.stderr


@pytest.mark.slow
def test_verify_remakes_a_row_by_its_printed_command(run: Callable[..., Result]) -> None:
    entry = entered(run, "category-median")
    for how, words in (
        ("rescored", ()),
        ("rescored", ("--submission", "category-median.npz")),
        ("remade", ("--remake",)),
    ):
        done = run("verify", entry, *words)
        assert done.exit_code == 0
        assert f": {how}, " in done.stdout
        assert "every text compared, all agree; largest relative difference 0; " in done.stdout
    other = run("verify", entry, "--submission", "nope.npz")
    assert (other.exit_code, other.stderr) == (1, "Error: nope.npz: No such file or directory\n")
    run("baseline", "water")
    assert (
        "is not the entry's submission" in run("verify", entry, "--submission", "water.npz").stderr
    )


def test_verify_notes_that_a_row_came_out_again(run: Callable[..., Result], tmp_path: Path) -> None:
    entry = entered(run, "train-median")
    before = files(tmp_path)
    assert run("verify", entry).exit_code == 0
    assert files(tmp_path) == before
    unsigned = run("verify", entry, "--recomputed", "--json")
    assert json.loads(unsigned.stdout)["same"] is True
    assert "it counts nothing here: no key of maintainers.toml has signed it" in unsigned.stderr
    run("leaderboard")
    page = tmp_path / "LEADERBOARD.md"
    assert "| self-reported" in page.read_text()
    assert "a note that it was recomputed counts nothing: it is not signed" in page.read_text()
    public = json.loads(run("keygen", "m.key", "--team", "maintainer", "--json").stdout)
    trust = f'[keys]\n"maintainer" = "{public["public_key"]}"\n'
    (tmp_path / "benchmarks/results/maintainers.toml").write_text(trust)
    words = ("verify", entry, "--recomputed", "--signing-key", "m.key")
    assert run(*words).exit_code == 0
    note = json.loads(Path(entry).with_suffix(".recomputed.json").read_text())
    assert note["command"] == f"xden-bench {' '.join(words)}"
    assert {"method", "warnings", "dataset", "metrics", "object_scores"} <= set(note["vouches_for"])
    assert note["not_verifiable"] == ["command", "commit", "date", "xden_version"]
    run("leaderboard")
    assert "| recomputed 20" in page.read_text()
    assert "is there already" in run(*words).stderr


def test_verify_refuses_numbers_that_another_file_gave(
    run: Callable[..., Result], submission: Submit
) -> None:
    words = "xden-bench baseline category-median"
    path = submission(lambda _, grid: 1.1 * grid, method="forged", command=words)
    entry = json.loads(run("submit", path, "--json").stdout)["file"]
    done = run("verify", entry, "--remake", "--recomputed")
    assert done.exit_code == 1
    assert re.search(r"remade, \d+ numbers and every text compared, \d+ differ; ", done.stdout)
    assert "bootstrap" not in done.stdout
    assert "and " in done.stdout.splitlines()[-1]
    assert not Path(entry).with_suffix(".recomputed.json").exists()


def test_a_team_enters_under_its_key_and_withdraws_with_it(
    run: Callable[..., Result], submission: Submit, tmp_path: Path
) -> None:
    for name in ("ours", "theirs"):
        assert run("keygen", f"{name}.key", "--team", name).exit_code == 0
    path = submission(lambda _, grid: 1.1 * grid, method="Our net")
    made = run("submit", path, "--signing-key", "ours.key", "--json")
    entry = json.loads(made.stdout)["file"]
    stolen = submission(lambda _, grid: 1.2 * grid, "b.npz", method="0ur-net")
    refused = run("submit", stolen, "--signing-key", "theirs.key")
    assert "the method name '0ur-net' belongs to the entry" in refused.stderr
    words = ("withdraw", entry, "--reason", "a bug | in <it>", "--signing-key")
    refused = run(*words, "theirs.key")
    assert "the key of 'theirs' is neither its team's nor a maintainer's" in refused.stderr
    assert run(*words, "ours.key").exit_code == 0
    assert run("leaderboard").exit_code == 0
    page = (tmp_path / "LEADERBOARD.md").read_text()
    assert "|        | ~~Our net~~" in page
    assert "team ours; not ranked: withdrawn: a bug \\| in &lt;it\\>" in page


def test_a_bad_entry_is_left_out_of_the_page_and_refused_by_the_check(
    run: Callable[..., Result], tmp_path: Path
) -> None:
    bad, good = (Path(entered(run, name)) for name in ("water", "zero"))
    bad.write_text(bad.read_text().replace("water.npz", "<!-- results: end -->"))
    done = run("leaderboard")
    assert done.exit_code == 0
    assert done.stderr.startswith(f"left out: {bad}: no text may hold <!--")
    assert done.stdout.endswith("LEADERBOARD.md: 1 entries\n")
    checked = run("leaderboard", "--check")
    assert (checked.exit_code, good.is_file()) == (1, True)
    assert "no text may hold <!-- nor -->" in checked.stderr


def test_tables_by_group_are_printed_and_nothing_is_written(
    run: Callable[..., Result], tmp_path: Path
) -> None:
    entered(run, "water")
    before = files(tmp_path)
    assert "| hollow " in run("leaderboard", "--by", "category", "--metric", "mass_mape").stdout
    (row,) = json.loads(run("leaderboard", "--by", "size", "--json").stdout)
    assert row["by_size"]["under 8 cm"]["n_objects"] == 4
    assert files(tmp_path) == before


def test_the_hubs_files_are_written_for_ranked_rows(
    run: Callable[..., Result], submission: Submit, tmp_path: Path
) -> None:
    entered(run, "water")
    run("submit", submission(lambda _, grid: 1.1 * grid, method="My net"))
    said = run("leaderboard", "--eval-results", ".eval_results").stdout.splitlines()
    assert said[0].startswith(".eval_results/my-net-")
    assert said[1:] == ["left out: water: not ranked: trivial"]
    assert (tmp_path / said[0]).is_file()
    assert not (tmp_path / "LEADERBOARD.md").exists()


def test_speed_prints_a_ratio(run: Callable[..., Result]) -> None:
    assert "ratio" in run("speed", "--repeats", "1").stdout
    measured: dict[str, Any] = json.loads(run("speed", "--repeats", "1", "--json").stdout)
    assert measured["objects"] == 4
    assert measured["ratio"] == pytest.approx(measured["score_seconds"] / measured["read_seconds"])


def test_every_command_has_an_example() -> None:
    for name in cli.commands:
        text = CliRunner().invoke(cli, [name, "--help"]).stdout
        assert text.rstrip().splitlines()[-1].strip().startswith(f"Example: xden-bench {name}")
    for name in segment.commands:
        text = CliRunner().invoke(cli, ["segment", name, "--help"]).stdout
        assert f"Example: xden-bench segment {name} " in text
