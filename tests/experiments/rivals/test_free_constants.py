"""What is free is a keyword of its law."""

import inspect

import pytest

from experiments.rivals.laws import RIVALS
from experiments.rivals.laws.free import FREE


@pytest.mark.parametrize("rival", FREE)
def test_what_is_free_is_a_keyword_of_its_law_and_its_own_value_is_tried(rival):
    parameters = inspect.signature(RIVALS[rival]).parameters
    own = {name: parameters[name].default for name in FREE[rival][0]}
    assert own in FREE[rival]
    assert all(constants.keys() == own.keys() for constants in FREE[rival])
    assert len({tuple(constants.items()) for constants in FREE[rival]}) == len(FREE[rival])
