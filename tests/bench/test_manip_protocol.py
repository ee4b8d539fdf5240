"""The protocol of manipulation is read whole or refused by name."""

from __future__ import annotations

from pathlib import Path

import pytest

from xden1k.errors import DataError
from xden_bench.manip.protocol import PROTOCOL, load_manip_protocol


def changed(tmp_path: Path, old: str, new: str) -> Path:
    text = PROTOCOL.read_text()
    assert old in text
    path = tmp_path / "manip.toml"
    path.write_text(text.replace(old, new, 1))
    return path


def test_every_table_of_the_protocol_is_a_value() -> None:
    rules = load_manip_protocol()
    assert rules.regimes["hard"].grip_force_n == [10.0, 20.0]
    assert rules.tiers["full"].off == 30
    assert rules.max_best_weight_n == pytest.approx(0.64 * 20)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("hold_s =", "hold =", r"manip.toml: \[trial\]: unknown keys \['hold'\]"),
        ("draws = 4\n", "", r"manip.toml: \[tiers.quick\]: .*draws"),
        ("[rest]", "[rests]", r"manip.toml: \[rest\]: .*missing (7|a) required"),
        ("seed = 20251210", "seed = ", r"manip.toml: not valid TOML"),
    ],
)
def test_a_protocol_with_a_fault_is_refused_by_its_table(tmp_path, old, new, said) -> None:
    with pytest.raises(DataError, match=said):
        load_manip_protocol(changed(tmp_path, old, new))
