"""What was tried to fool the board, each by name: none of it is believed."""

from __future__ import annotations

import copy
import datetime
import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from tests.bench.conftest import submissions
from tests.bench.test_hostile_entries import with_objects
from xden1k.errors import DataError
from xden_bench.entries.admission import EnteredError, Quota, check_admission, light_entries
from xden_bench.entries.amendments import amend
from xden_bench.entries.archive import archived
from xden_bench.entries.identities import contradictions
from xden_bench.entries.leaderboard import tables
from xden_bench.entries.ranking import unranked_because
from xden_bench.entries.reading import read_entries, read_entry, read_sound_entries
from xden_bench.entries.recomputed import write_recomputed
from xden_bench.entries.result import entry_of, entry_path, write_entry
from xden_bench.entries.signing import (
    MAINTAINERS,
    SigningKey,
    is_signed,
    read_maintainers,
    read_signing_key,
    write_signing_key,
)
from xden_bench.entries.verification import NOT_VERIFIABLE, verify
from xden_bench.methods.baseline import builtin_names
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.score import Score, score

RULES = load_protocol()
TOLERATED = 1e-6
"""Verifying takes numbers no further apart for the same."""
DAY = datetime.date(2026, 1, 2)
Submit = Callable[..., Path]
TEAM, OTHERS = (SigningKey(name, Ed25519PrivateKey.generate()) for name in ("Team", "Others"))


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory, reference: Reference) -> Path:
    write = submissions(tmp_path_factory.mktemp("forgeries"), reference)
    return write(lambda _, grid: 1.1 * grid, method="a net", seed=7, notes="a note")


@pytest.fixture(scope="module")
def scored(file: Path, reference: Reference) -> Score:
    return score(file, reference, RULES)


@pytest.fixture(scope="module")
def made(scored: Score, reference: Reference) -> dict[str, Any]:
    return entry_of(scored, reference, command="xden-bench submit preds.npz", date=DAY)


def named(made: dict[str, Any], name: str, arrays: str = "0", **more: Any) -> dict[str, Any]:
    """An entry of another name, file and arrays."""
    changed = copy.deepcopy(made) | {"arrays_sha256": arrays * 64, **more}
    changed["method"]["name"] = name
    return changed | {"submission_sha256": f"{hash((name, arrays)) % 16**8:08x}" + "0" * 56}


# Any change of a field


def leaves(value: Any, *path: str | int) -> Iterator[tuple[str | int, ...]]:
    """The place of everything in a value of JSON, inner nodes included."""
    if path:
        yield path
    items: Any = value.items() if isinstance(value, dict) else ()
    for key, one in enumerate(value) if isinstance(value, list) else items:
        yield from leaves(one, *path, key)


def place_of(entry: dict[str, Any], path: tuple[str | int, ...]) -> Any:
    place: Any = entry
    for key in path[:-1]:
        place = place[key]
    return place


def other_values(value: Any) -> Iterator[Any]:
    """Values of other types, and others of the same type that look sound."""
    yield from (one for one in (None, "x", True, [], {}, 1e9) if one != value)
    if isinstance(value, bool):
        yield not value
    elif isinstance(value, int | float):
        yield from (value + 1, value * 0.999 if abs(value) > TOLERATED else 0.001, value + 0.5)
    elif isinstance(value, str):
        yield from (f"{value}x", value[::-1] + "a", "0" * 64, "2020-01-01")


def attacks(entry: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every change of one place: its value, its type, gone, or with something beside it."""
    for path in leaves(entry):
        place, key = place_of(entry, path), path[-1]
        for other in other_values(place[key]):
            changed = copy.deepcopy(entry)
            place_of(changed, path)[key] = other
            yield f"{path} = {other!r}", changed
        changed = copy.deepcopy(entry)
        place_of(changed, path).pop(key)
        yield f"{path} gone", changed
        if isinstance(place[key], dict):
            changed = copy.deepcopy(entry)
            place_of(changed, path)[key]["more"] = 1
            yield f"{path} and more", changed


def is_only_of_the_environment(entry: dict[str, Any], changed: dict[str, Any]) -> bool:
    """Whether all that changed is what no scoring can find again."""
    differing = {key for key in entry.keys() | changed.keys() if entry.get(key) != changed.get(key)}
    return differing <= set(NOT_VERIFIABLE)


def write_forged(changed: dict[str, Any], honest: Path, results: Path) -> Path:
    """Put a changed entry where its content belongs, its objects beside it."""
    path = results / entry_path(changed)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(changed))
    path.with_suffix(".parquet").write_bytes(honest.with_suffix(".parquet").read_bytes())
    return path


def believed(
    changed: dict[str, Any], honest: Path, results: Path, scored: Score, reference: Reference
) -> bool:
    """Whether neither reading nor verifying finds the change."""
    path: Path | None = None
    try:
        path = write_forged(changed, honest, results)
        found = verify(read_entry(path, results), scored, reference)
    except (DataError, KeyError, TypeError, AttributeError, ValueError):
        return False
    finally:
        if path is not None:
            path.unlink(missing_ok=True)
    return not found.deviations and found.same_file


@pytest.fixture
def shallow(monkeypatch: pytest.MonkeyPatch) -> None:
    """Intervals of few resamples: the same code, in no time."""
    quick = replace(RULES, bootstrap_resamples=20)
    for module in ("entries.reading", "entries.entry_form"):
        monkeypatch.setattr(f"xden_bench.{module}.load_rules", lambda _: quick)


@pytest.mark.parametrize(
    ("key", "share"),
    [
        (None, 61),
        pytest.param(None, 1, marks=pytest.mark.slow),
        pytest.param(TEAM, 1, marks=pytest.mark.slow),
    ],
)
@pytest.mark.usefixtures("shallow")
def test_no_change_of_a_field_is_believed(
    file: Path, reference: Reference, tmp_path: Path, key: SigningKey | None, share: int
) -> None:
    quick = score(file, reference, replace(RULES, bootstrap_resamples=20))
    entry = entry_of(quick, reference, command="xden-bench submit preds.npz", date=DAY)
    honest = write_entry(entry, quick, tmp_path / "honest", submission=file, key=key)
    stored = json.loads(honest.read_text())
    results = tmp_path / "forged"
    assert believed(stored, honest, results, quick, reference)
    tried = list(attacks(stored))[::share]
    assert len(tried) >= 40
    fooled = [
        what
        for what, changed in tried
        if believed(changed, honest, results, quick, reference)
        and (key is not None or not is_only_of_the_environment(stored, changed))
    ]
    assert set(fooled) <= {"('archive',) gone"}  # which costs the rank of any protocol after v1


# Fault by fault


def test_an_oracle_that_only_renames_itself_does_not_come_out_again(
    submission: Submit, reference: Reference, tmp_path: Path
) -> None:
    oracle = score(submission(method="part-oracle", inputs=("parts", "truth")), reference, RULES)
    made = entry_of(oracle, reference, command="xden-bench submit x.npz", date=DAY)
    made |= {"warnings": [], "date": "2025-12-31", "commit": "0" * 40}
    made["method"] |= {"name": "honest net", "inputs": ["parts"]}
    read = read_entry(write_entry(made, oracle, tmp_path))
    found = verify(read, oracle, reference)
    where = {one.where for one in found.deviations}
    assert {"method.name", "method.inputs[1]", "warnings[0]"} <= where
    with pytest.raises(DataError, match="nothing to vouch for"):
        write_recomputed(tmp_path / entry_path(made), "rescored", found, "", DAY, TEAM, tmp_path)


def test_invented_errors_of_objects_contradict_themselves(
    made: dict[str, Any], scored: Score, tmp_path: Path
) -> None:
    path = write_entry(made, scored, tmp_path)
    table = pq.read_table(path.with_suffix(".parquet"))
    place = table.column_names.index("mass_alde")
    better = table.set_column(place, "mass_alde", pa.array([0.001] * len(table)))
    with_objects(path, pq_bytes(better))
    with pytest.raises(DataError, match="metrics is not what the objects"):
        read_entry(path)


def pq_bytes(table: pa.Table) -> bytes:
    stream = pa.BufferOutputStream()
    pq.write_table(table, stream)
    return bytes(stream.getvalue().to_pybytes())


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        ({"mass_alde": 0.001}, "mass_mnre = exp"),
        ({"mass_mape": 0.5}, "mass_mape = 1 - mass_mnre"),
        ({"com_l2_cm": 9.0}, "com_l2_cm <= com_l1_cm"),
        ({"com_l1_cm": 9.0}, "com_l2_cm <= com_l1_cm"),
        ({"nonuniformity_error": 1.5}, "nonuniformity_error <= 1"),
        ({"density_mae_g_cm3": -0.1}, "density_mae_g_cm3 is finite and not negative"),
        ({"inertia_error": float("nan")}, "inertia_error is finite and not negative"),
        ({"density_crps_g_cm3": 0.0}, "density_crps_g_cm3 >= 0.595"),
        ({"density_within_1sd": 0.9, "density_within_2sd": 0.5}, "density_within_1sd <="),
    ],
)
def test_each_identity_of_the_metrics_is_held(
    scored: Score, change: dict[str, float], rule: str
) -> None:
    one = scored.objects[0].metrics
    assert list(contradictions(one, RULES)) == []
    assert any(told.startswith(rule) for told in contradictions({**one, **change}, RULES))


def test_the_same_arrays_are_entered_once_whatever_they_are_called(
    submission: Submit, reference: Reference, tmp_path: Path
) -> None:
    for number, name in enumerate(("first", "second")):
        path = submission(lambda _, grid: 1.1 * grid, f"{number}.npz", method=name)
        again = score(path, reference, RULES)
        entry = entry_of(again, reference, command="", date=DAY)
        if name == "first":
            write_entry(entry, again, tmp_path / "results", submission=path)
        else:
            with pytest.raises(EnteredError, match=r"predictions are entered already: .*first-"):
                write_entry(entry, again, tmp_path / "results", submission=path)


@pytest.mark.parametrize("content", [None, b"no parquet", "text"])
def test_a_damaged_neighbour_stops_no_entry(
    submission: Submit, reference: Reference, tmp_path: Path, content: bytes | str | None
) -> None:
    results = tmp_path / "results"
    for number, name in enumerate(("first", "second")):
        path = submission(lambda _, grid, n=number: (1.1 + n) * grid, f"{number}.npz", method=name)
        scored = score(path, reference, RULES)
        entry = entry_of(scored, reference, command="", date=DAY - datetime.timedelta(number))
        objects = write_entry(entry, scored, results, submission=path).with_suffix(".parquet")
        if content is None:
            objects.unlink()
        elif isinstance(content, bytes):
            objects.write_bytes(content)
        else:
            table = pq.read_table(objects).to_pydict()
            words = {RULES.rank_by: ["high"] * len(table["object_id"])}
            pq.write_table(pa.table(table | words), objects)
    assert len(list(results.rglob("*.json"))) == 2


@pytest.mark.parametrize("days", [-1, 0, 1])
def test_a_copy_that_would_come_before_what_it_copies_is_refused(
    submission: Submit, reference: Reference, tmp_path: Path, days: int
) -> None:
    """An earlier date, or of one day a lesser checksum, would give it the other's rank."""
    results = tmp_path / "results"
    files = [
        submission(lambda _, grid, by=by: by * grid, f"{by}.npz", method=f"of {by}")
        for by in (1.1, 1.1002)
    ]
    every = [(score(file, reference, RULES), file) for file in files]
    (copied, copy_file), (there, file) = sorted(every, key=lambda one: one[0].submission_sha256)
    first, second = (
        entry_of(each, reference, command="", date=date)
        for each, date in ((there, DAY), (copied, DAY + datetime.timedelta(days)))
    )
    write_entry(first, there, results, submission=file)
    if days > 0:
        write_entry(second, copied, results, submission=copy_file)
        rows = [row for table in tables(read_entries(results)) for row in table]
        assert [row.get("merged") for row in rows] == [
            None,
            f"a copy of {first['method']['name']}, which came first",
        ]
    else:
        with pytest.raises(EnteredError, match=r"nearly those of .*, which was entered before: "):
            write_entry(second, copied, results, submission=copy_file)


@pytest.mark.parametrize(
    "name",
    ["xray-unet", "X-Ray UNet", "xray-unet v2", "official builder", "NeRF2Physics zero-shot"],
)
def test_names_of_built_in_methods_are_kept(made: dict[str, Any], name: str) -> None:
    with pytest.raises(DataError, match="is kept for what `xden-bench baseline"):
        check_admission(named(made, name), [])


@pytest.mark.parametrize("name", sorted(builtin_names()))
def test_each_built_in_method_may_have_its_own_name(made: dict[str, Any], name: str) -> None:
    entry = named(made, name)
    entry["method"]["command"] = f"xden-bench baseline {name} --out preds.npz"
    check_admission(entry, [])


@pytest.mark.parametrize(
    "name", ["pixie", "PIXIE", "Pixie (official)", "p1xie", "NeRF2Physics v2", "nerf2physics"]
)
def test_names_of_published_methods_are_nobodys(made: dict[str, Any], name: str) -> None:
    with pytest.raises(DataError, match="is too near to one of the paper's"):
        check_admission(named(made, name), [])


@pytest.mark.parametrize("name", ["my pixie for X-rays", "NeRF", "builder of nets", "pixienet"])
def test_names_that_only_remind_of_them_are_free(made: dict[str, Any], name: str) -> None:
    check_admission(named(made, name), [])


def test_a_built_in_method_keeps_its_name_by_its_command(made: dict[str, Any]) -> None:
    own = named(made, "xray-unet")
    own["method"]["command"] = "xden-bench baseline xray-unet --out p.npz"
    check_admission(own, [])


def test_a_name_belongs_to_the_key_that_entered_it_first(made: dict[str, Any]) -> None:
    first = named(made, "Great Net", team=TEAM.team)
    check_admission(named(made, "great-net", "1", team=TEAM.team), [(Path("a"), first)])
    for team in ({"team": OTHERS.team}, {}):
        with pytest.raises(DataError, match="the method name 'great_net' belongs to the entry a"):
            check_admission(named(made, "great_net", "1", **team), [(Path("a"), first)])
    twin = {"team": {"name": "T-eam", "public_key": OTHERS.public_key}}
    with pytest.raises(DataError, match="the team name 'T-eam' belongs to the entry a"):
        check_admission(named(made, "another", "1", **twin), [(Path("a"), first)])


def test_a_team_has_a_quota_a_day_and_in_all(made: dict[str, Any]) -> None:
    others = [
        (Path(f"{one}"), named(made, "net", f"{one}", team=TEAM.team, date=f"2026-01-0{one + 1}"))
        for one in range(2)
    ]
    new = named(made, "net", "9", team=TEAM.team)
    with pytest.raises(DataError, match="the team 'Team' has entered 1 of 1 on this day"):
        check_admission(new, others, Quota(a_day=1))
    with pytest.raises(DataError, match="the team 'Team' has entered 2 of 2 in all"):
        check_admission(new, others, Quota(in_all=2))
    check_admission(named(made, "mine", "9", team=OTHERS.team), others, Quota(1, 1))


def test_a_broken_file_among_the_results_stops_nobody(
    made: dict[str, Any], scored: Score, tmp_path: Path
) -> None:
    good = write_entry(made, scored, tmp_path)
    bad = good.with_name("bad.json")
    bad.write_text(json.dumps({**made, "method": 3}))
    assert [one for one, _ in light_entries(tmp_path)] == [good.relative_to(tmp_path)]
    (kept,), (problem,) = read_sound_entries(tmp_path)
    assert kept["submission_sha256"] == made["submission_sha256"]
    assert problem.startswith(f"{bad}: not a result of schema")
    with pytest.raises(DataError, match="method is of the wrong type, int"):
        read_entries(tmp_path)


def test_a_signed_entry_is_its_teams_to_the_last_digit(
    made: dict[str, Any], scored: Score, file: Path, tmp_path: Path
) -> None:
    path = write_entry(made, scored, tmp_path, submission=file, key=TEAM)
    assert read_entry(path)["team"]["name"] == "Team"
    values = json.loads(path.read_text())
    for change in ({"date": "2026-01-03"}, {"team": OTHERS.team}, {"signature": "0" * 128}):
        path.write_text(json.dumps(values | change))
        with pytest.raises(DataError, match="the signature is not that of the team"):
            read_entry(path)
    del values["signature"]
    path.write_text(json.dumps(values))
    with pytest.raises(DataError, match="team and signature go together"):
        read_entry(path)


def test_only_its_team_or_a_maintainer_withdraws_an_entry(
    made: dict[str, Any], scored: Score, file: Path, tmp_path: Path
) -> None:
    path = write_entry(made, scored, tmp_path, submission=file, key=TEAM)
    note = amend(path, "withdrawn", "envy", DAY, OTHERS)
    read = read_entry(path)
    assert unranked_because(read) is None
    assert read["remarks"] == [
        f"a note (withdrawn) counts nothing: the key {OTHERS.public_key[:8]} is not trusted here"
    ]
    note.unlink()
    amend(path, "erratum", "a slip", DAY, TEAM)
    assert unranked_because(read_entry(path)) is None
    amend(path, "withdrawn", "a bug", DAY, TEAM)
    read = read_entry(path)
    assert (unranked_because(read), read["erratum"]["text"]) == ("withdrawn: a bug", "a slip")
    with pytest.raises(DataError, match="is there already: it is never changed"):
        amend(path, "withdrawn", "again", DAY, TEAM)


def test_a_remade_row_is_no_copy_and_a_rescored_one_still_is(made: dict[str, Any]) -> None:
    row = copy.deepcopy(made) | {"warnings": ["W504: the values of the reference, within 1%: x"]}
    for how, reason in (("rescored", "its values are those of the reference"), ("remade", None)):
        assert unranked_because({**row, "recomputed": {"how": how}}) == reason


def test_of_a_team_the_best_row_of_a_table_is_ranked(
    submission: Submit, reference: Reference, tmp_path: Path
) -> None:
    for by in (1.3, 1.1, 1.2):
        path = submission(lambda _, grid, by=by: by * grid, f"{by}.npz", method=f"net {by}")
        found = score(path, reference, RULES)
        entry = entry_of(found, reference, command="", date=DAY)
        write_entry(entry, found, tmp_path / "results", submission=path, key=TEAM)
    reasons = {
        one["method"]["name"]: unranked_because(one) for one in read_entries(tmp_path / "results")
    }
    worse = "another row of Team is better"
    assert reasons == {"net 1.1": None, "net 1.2": worse, "net 1.3": worse}


def test_the_archived_submission_is_the_one_that_was_scored(
    made: dict[str, Any], scored: Score, file: Path, tmp_path: Path
) -> None:
    read = read_entry(write_entry(made, scored, tmp_path, submission=file))
    stored = archived(read, tmp_path)
    assert stored.read_bytes() == file.read_bytes()
    stored.write_bytes(b"another")
    with pytest.raises(DataError, match="sha256 must be"):
        archived(read, tmp_path)
    stored.unlink()
    with pytest.raises(DataError, match="the entry's submission lies there or is given"):
        archived(read, tmp_path)


def test_a_file_changed_while_it_was_scored_is_not_archived(
    made: dict[str, Any], scored: Score, tmp_path: Path
) -> None:
    other = tmp_path / "other.npz"
    other.write_bytes(b"another")
    with pytest.raises(DataError, match="sha256 must be"):
        write_entry(made, scored, tmp_path / "results", submission=other)
    left = {one.name for one in (tmp_path / "results").rglob("*") if one.is_file()}
    assert left == {".lock"}


# Keys


def test_a_key_comes_back_from_its_file_and_is_its_owners_alone(tmp_path: Path) -> None:
    path = tmp_path / "team.key"
    key = write_signing_key(path, "Some Lab")
    again = read_signing_key(path)
    assert (again.name, again.public_key) == ("Some Lab", key.public_key)
    assert is_signed(again.signed({"schema": "x"}), key.public_key)
    assert "private" not in repr(key)
    with pytest.raises(DataError, match="a key is never overwritten"):
        write_signing_key(path, "Some Lab")
    path.chmod(0o644)
    with pytest.raises(DataError, match="others may read this key"):
        read_signing_key(path)


@pytest.mark.parametrize("name", ["", " ", "a\nb", "x" * 81, "L\u0430b"])
def test_a_team_has_a_name_that_can_be_printed(tmp_path: Path, name: str) -> None:
    with pytest.raises(DataError, match="the name of a key's holder must be 1 to 80 printable"):
        write_signing_key(tmp_path / "team.key", name)


@pytest.mark.parametrize("text", ["[keys]\nm = 3", "[keys]\nm = 'x'", "keys = 3", "[more]"])
def test_a_file_of_maintainers_holds_public_keys_alone(tmp_path: Path, text: str) -> None:
    assert read_maintainers(tmp_path) == {}
    (tmp_path / MAINTAINERS).write_text(text)
    with pytest.raises(DataError, match=r"must hold one table \[keys\]"):
        read_maintainers(tmp_path)
