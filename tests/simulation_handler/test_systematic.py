"""What the systematic errors of some objects tell of that of another one."""

from __future__ import annotations

import math

import pytest

from simulation_handler.perception.systematic import ErrorOfAnother, KnownError, KnownErrors, error_of_another

SHARED = 0.01


def told_by(*metres: float, may_lean: bool = False) -> ErrorOfAnother:
    return error_of_another([KnownError(error, may_lean) for error in metres], SHARED)


def test_without_others_an_error_is_as_unknown_as_the_shared_part() -> None:
    nothing = told_by()
    assert nothing.mean == 0.0 and nothing.scale == pytest.approx(SHARED, rel=0.01) and math.isinf(nothing.freedom)


def test_the_more_agree_the_surer_is_the_error_of_another() -> None:
    one, four = told_by(0.008), told_by(0.008, 0.0082, 0.0079, 0.0081)
    assert one.mean == pytest.approx(0.008, abs=0.0003) and one.freedom == 1.0
    assert four.mean == pytest.approx(0.008, abs=0.0001) and four.freedom == 4.0
    assert four.scale < 0.0007 < one.scale < SHARED


def test_errors_that_differ_leave_that_of_another_as_unsure() -> None:
    assert 0.003 < told_by(-0.004, 0.001, 0.006, 0.0).scale < 0.006


@pytest.mark.parametrize("astray", [0.006, -0.012])
def test_what_may_lean_and_has_another_error_than_all_others_tells_nothing(astray: float) -> None:
    agreeing = [KnownError(error, may_lean=True) for error in (0.0, 0.0003, -0.0002, 0.0001)]
    found = error_of_another([*agreeing, KnownError(astray, may_lean=True)], SHARED)
    assert found == error_of_another(agreeing, SHARED)
    must_rest = error_of_another([*agreeing, KnownError(astray, may_lean=False)], SHARED)
    assert must_rest.scale > 3.0 * found.scale, "its error is its own"


def test_of_two_that_differ_neither_is_believed_alone() -> None:
    assert told_by(0.0, 0.008, may_lean=True).scale > 0.004


def test_errors_that_are_noted_one_by_one_tell_what_all_together_do() -> None:
    known = [KnownError(0.001 * k, may_lean=k % 3 > 0) for k in (4, -1, 0, 7, 4, 2)]
    errors = KnownErrors(SHARED)
    for number, error in enumerate(known):
        errors.note(str(number), KnownError(0.02, may_lean=False))
        errors.note(str(number), error)
    for number in range(len(known)):
        assert errors.of_another(str(number)) == error_of_another(known[:number] + known[number + 1 :], SHARED)
    errors.note("0", None)
    assert errors.of_another("0") == errors.of_another("unknown") == error_of_another(known[1:], SHARED)
