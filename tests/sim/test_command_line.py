from __future__ import annotations

import pytest

from sim.__main__ import main
from tests.sim.client import CONFIGS


def test_a_missing_mission_file_is_bad_configuration():
    with pytest.raises(SystemExit) as ended:
        main(CONFIGS / "none.yaml", "tcp://127.0.0.1:5760", 1.0, 1)
    assert ended.value.code == 2


def test_an_address_of_no_known_kind_is_a_link_failure():
    with pytest.raises(SystemExit) as ended:
        main(CONFIGS / "first-flight.yaml", "serial:///dev/ttyS0", 1.0, 1)
    assert ended.value.code == 3
