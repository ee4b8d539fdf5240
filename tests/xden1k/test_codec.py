"""Arrays to bytes and back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from xden1k.errors import DataError
from xden1k.format.codec import (
    MAX_TRANSMISSION,
    ArrayCodec,
    encode_density,
    encode_share,
    encode_transmission,
    from_planes,
    to_planes,
)

STORED = ("|u1", "<u2", "<f2", "<f4", "<i4")
STEP = MAX_TRANSMISSION / 65535


@given(
    st.sampled_from([np.dtype(name) for name in STORED]).flatmap(
        lambda dtype: hnp.arrays(dtype, hnp.array_shapes(min_dims=1, max_dims=3, min_side=0))
    )
)
def test_planes_give_back_every_bit(values: np.ndarray) -> None:
    back = from_planes(to_planes(values), values.dtype, values.shape)
    assert back.tobytes() == values.tobytes()
    assert back.flags.writeable


@given(hnp.arrays(np.uint16, hnp.array_shapes(max_dims=2)))
def test_planes_are_all_low_bytes_then_all_high_bytes(values: np.ndarray) -> None:
    expected = [value & 255 for value in values.ravel()] + [value >> 8 for value in values.ravel()]
    assert list(to_planes(values)) == expected


def test_planes_of_a_strided_or_foreign_array_are_those_of_its_values() -> None:
    values = np.arange(24, dtype=np.int32).reshape(4, 6)
    assert to_planes(values.T) == to_planes(values.T.copy())
    assert to_planes(values.astype(">i4")) == to_planes(values)


@pytest.mark.parametrize(("shape", "count"), [((2, 3), 5), ((-1, 3), 7), ((-1, 0), 1)])
def test_a_wrong_number_of_bytes_is_refused(shape: tuple[int, ...], count: int) -> None:
    with pytest.raises(DataError, match=f"{count} bytes do not make uint8 values of shape"):
        from_planes(bytes(count), np.dtype(np.uint8), shape)


def test_a_shape_in_another_column_must_be_passed() -> None:
    codec = ArrayCodec("<u2", "xray_pa_shape", STEP)
    with pytest.raises(DataError, match="xray_pa_shape"):
        codec.decode(bytes(4))
    assert codec.decode(bytes(4), (1, 2)).tolist() == [[0, 0]]


@given(hnp.arrays(np.float32, (5, 4), elements=st.floats(-1, 3, width=32)), st.data())
def test_transmission_keeps_mask_and_value_to_half_a_step(
    image: np.ndarray, data: st.DataObject
) -> None:
    valid = data.draw(hnp.arrays(bool, image.shape))
    codes = encode_transmission(np.where(valid, image, np.float32(np.nan)), valid)
    assert ((codes > 0) == valid).all()
    decoded = ArrayCodec("<u2", (5, 4), STEP).decode(to_planes(codes))
    assert decoded.dtype == np.float32
    held = image.clip(STEP, MAX_TRANSMISSION)
    assert np.abs(decoded - held)[valid].max(initial=0) <= 0.501 * STEP
    assert (encode_transmission(decoded, valid) == codes).all()


def test_every_transmission_code_survives_decoding_and_encoding() -> None:
    codes = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    decoded = ArrayCodec("<u2", codes.shape, STEP).decode(to_planes(codes))
    assert (encode_transmission(decoded, codes > 0) == codes).all()


@given(hnp.arrays(np.float64, (2, 3, 4), elements=st.floats(0, 1)))
def test_share_keeps_value_to_half_a_step(share: np.ndarray) -> None:
    codes = encode_share(share)
    decoded = ArrayCodec("|u1", share.shape, 1 / 255).decode(to_planes(codes))
    assert np.abs(decoded - share).max() <= 0.501 / 255
    assert (encode_share(decoded) == codes).all()


@pytest.mark.parametrize("bad", [-0.01, 1.01, np.nan])
def test_share_outside_zero_to_one_is_refused(bad: float) -> None:
    with pytest.raises(DataError, match="a share must be 0 to 1"):
        encode_share(np.full((1, 1, 1), bad))


def test_density_beyond_half_precision_is_refused() -> None:
    assert encode_density(np.full((1, 1, 1), 19.3)).dtype == np.float16
    with pytest.raises(DataError, match="does not fit into float16"):
        encode_density(np.full((1, 1, 1), 7e4))
