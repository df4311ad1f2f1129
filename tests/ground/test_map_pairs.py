"""The command that compares paths over a map with OMPL's: what it says of a plain."""

import re
import sys

import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin

from tests.ground import map_pairs


@pytest.mark.thorough
def test_pairs_over_a_plain_are_all_joined(tmp_path, monkeypatch, capsys):
    file = tmp_path / "plain.tif"
    layout = from_origin(780_000.0, 190_000.0, 25.0, 25.0)
    with rasterio.open(
        file, "w", driver="GTiff", width=200, height=200, count=1, dtype="float32", crs="EPSG:21781",
        transform=layout,
    ) as made:  # fmt: skip
        made.write(np.full((200, 200), 500.0, dtype=np.float32), 1)
    monkeypatch.setattr(sys, "argv", ["map_pairs", str(file), "-n", "2", "--ompl", "2"])
    map_pairs.main()
    told = capsys.readouterr().out
    assert "2 of 2 reach the goal" in told
    ratio, most = map(
        float, re.search(r"ours are ([\d.]+) times as long \(median\), ([\d.]+)", told).groups()
    )
    assert 0.95 < ratio <= most < 1.05
