"""Arrays that wait on disk."""

import numpy as np
import pytest

from ident.errors import InputError
from ident.regression.spooled import SpooledArrays


def test_arrays_of_any_shape_come_back() -> None:
    """Law: entry by entry, from either end and in slices, what was written last; others in one file stay."""
    arrays = [np.random.default_rng(k).normal(size=shape) for k, shape in enumerate([(5,), (2, 3), (0, 4), (7, 1, 2)])]
    spooled = SpooledArrays()
    for k, array in enumerate(arrays):
        spooled.append(array)
        assert np.array_equal(spooled[k], array)
    assert all(np.array_equal(one, array) for one, array in zip(spooled, arrays, strict=True))
    assert np.array_equal(spooled[-1], arrays[-1])
    assert [one.shape for one in spooled[::2]] == [(5,), (0, 4)]
    assert not spooled[0].flags.writeable
    with pytest.raises(IndexError):
        spooled[4]
    other = SpooledArrays(arrays, beside=spooled)
    other[0], other[1] = np.arange(9.0), np.zeros((2, 3))
    assert [one.sum() for one in other] == [36.0, 0.0, 0.0, arrays[3].sum()]
    assert all(np.array_equal(one, array) for one, array in zip(spooled, arrays, strict=True))


def test_full_disk_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: where the disk of temporary files is full, one line says where and what helps."""

    class Full:
        def seek(self, place: int, whence: int = 0) -> None:
            raise OSError(28, "No space left on device")

    spooled = SpooledArrays()
    monkeypatch.setattr(spooled, "_file", Full())
    with pytest.raises(InputError, match="No space left on device; free some space there"):
        spooled.append(np.zeros(3))
