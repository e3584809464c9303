"""Words that the library does not know are refused, never taken for something else."""

from __future__ import annotations

import pytest

import insnav
from insnav.exceptions import ConfigError
from tests.cli.conftest import SAMPLE
from tests.refusals import refused


@pytest.mark.parametrize("options", [{"fault": "gps-outage@200s+30s"}, {"sed": 5}])
def test_an_unknown_word_of_a_simulation_is_refused(options):
    """By Python itself: the options are the signature, which editors show."""
    with pytest.raises(TypeError, match="unexpected keyword argument"):
        insnav.simulate("city", **options)


def test_unknown_words_of_a_drive_are_refused():
    drive = insnav.load(SAMPLE / "imu.csv.gz", gps=SAMPLE / "gps.csv", imu="automotive")
    for use, word in (
        (lambda: drive.navigate(aiding="yes"), "yes"),
        (lambda: drive.navigate(mechanization="shrt"), "shrt"),
        (lambda: drive.budget(time=(10,)), "time"),
    ):
        with refused(ConfigError, "input.unknown_word") as caught:
            use()
        assert caught.value.values["value"] == word
