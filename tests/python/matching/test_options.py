"""Options stand on both sides of the language border: fields and defaults must be equal."""

from __future__ import annotations

from dataclasses import fields

from videogrammetry._core import matching as core
from videogrammetry.matching import MatchingOptions


def test_fields_and_defaults_equal_those_of_cpp():
    theirs = core.MatchingOptions()
    names = {name for name in dir(theirs) if not name.startswith("_")}
    assert names == {field.name for field in fields(MatchingOptions)}
    for field in fields(MatchingOptions):
        if field.name != "min_log_odds":  # None: by the number of cameras
            assert getattr(theirs, field.name) == field.default, field.name
