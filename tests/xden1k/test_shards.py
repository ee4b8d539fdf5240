"""One Parquet file."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from tests import phantoms
from xden1k.errors import DataError
from xden1k.format.records import object_row
from xden1k.format.schema import ARRAY_COLUMNS, COLUMNS, DATA_SCHEMA, LIGHT_COLUMNS, METADATA_SCHEMA
from xden1k.format.shards import ShardReader, ShardWriter


@pytest.fixture(scope="module")
def rows() -> list[dict[str, Any]]:
    return [object_row(obj) for obj in phantoms.objects()]


@pytest.fixture
def shard(tmp_path: Path, rows: list[dict[str, Any]]) -> Path:
    return written(tmp_path / "shard.parquet", rows)


def written(path: Path, rows: list[dict[str, Any]]) -> Path:
    with closing(ShardWriter(path, DATA_SCHEMA)) as writer:
        for row in rows:
            writer.write(row)
    return path


def test_rows_come_back_as_they_were(shard: Path, rows: list[dict[str, Any]]) -> None:
    reader = ShardReader(shard)
    assert (reader.rows, reader.row_groups) == (len(rows), len(rows))
    for row, stored in zip(rows, reader, strict=True):
        for name, value in row.items():
            plain = bytes(stored[name]) if isinstance(value, bytes) else stored[name]
            assert repr(plain) == repr(value), name
    assert reader.row(2, ["split", "object_id"]).keys() == {"split", "object_id"}


def test_any_parquet_reader_and_any_hub_viewer_sees_plain_types(shard: Path) -> None:
    from datasets import Features, Value

    table = pq.read_table(shard)
    features = Features.from_arrow_schema(table.schema)
    assert features.arrow_schema.equals(DATA_SCHEMA, check_metadata=True)
    assert all(features[name] == Value("binary") for name in ARRAY_COLUMNS)


def test_only_the_id_has_statistics_and_nothing_a_dictionary(shard: Path) -> None:
    group = pq.ParquetFile(shard).metadata.row_group(0)
    columns = [group.column(i) for i in range(group.num_columns)]
    assert [c.path_in_schema for c in columns if c.is_stats_set] == ["object_id"]
    assert {c.compression for c in columns} == {"ZSTD"}
    assert not any(c.has_dictionary_page for c in columns)


def test_metadata_are_the_first_columns_of_data() -> None:
    assert METADATA_SCHEMA.names == list(LIGHT_COLUMNS) == DATA_SCHEMA.names[: len(LIGHT_COLUMNS)]
    assert len({column.name for column in COLUMNS}) == len(COLUMNS)


@pytest.mark.parametrize("kept", [0, 3, 5000, -100])
def test_a_truncated_shard_is_named(shard: Path, kept: int) -> None:
    shard.write_bytes(shard.read_bytes()[:kept])
    with pytest.raises(DataError, match=r"shard\.parquet: not a whole Parquet file"):
        ShardReader(shard)


def test_a_damaged_row_is_named(shard: Path) -> None:
    data = bytearray(shard.read_bytes())
    data[1000:2000] = bytes(1000)
    shard.write_bytes(data)
    with pytest.raises(
        DataError, match=r"shard\.parquet: cannot read bar-0001 \(row group 0\): .*CRC"
    ):
        ShardReader(shard).row(0)


def test_a_missing_shard_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="gone"):
        ShardReader(tmp_path / "gone.parquet")


@pytest.mark.parametrize("read", [lambda r: r.row(0, ["nope"]), lambda r: r.column("nope")])
def test_an_unknown_column_is_named(shard: Path, read: Any) -> None:
    with pytest.raises(DataError, match=r"no column \['nope'\]; columns are \['object_id'"):
        read(ShardReader(shard))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mass_g": "heavy"}, "bar-0001: column mass_g: .*heavy"),
        ({"com_cm": [1.0]}, "bar-0001: column com_cm: .*expected 3"),
    ],
)
def test_a_value_of_the_wrong_type_is_refused(
    tmp_path: Path, rows: list[dict[str, Any]], change: dict[str, Any], message: str
) -> None:
    with pytest.raises(DataError, match=message):
        written(tmp_path / "shard.parquet", [rows[0] | change])


def test_a_row_without_a_column_is_refused(tmp_path: Path, rows: list[dict[str, Any]]) -> None:
    short = {name: value for name, value in rows[0].items() if name != "labels"}
    with pytest.raises(DataError, match="bar-0001: no column labels"):
        written(tmp_path / "shard.parquet", [short])
