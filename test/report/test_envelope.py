# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The picture of an arm's workspace."""

import dataclasses
from pathlib import Path

import pytest

from epson_driver.report.envelope import PictureError, draw_envelope
from epson_driver.robots import load_robot_model

pytest.importorskip('matplotlib')


@pytest.mark.parametrize(
    ('name', 'words'),
    [
        ('gx8_c552s', ('reach 550 mm', 'J1 -62 … 242°', 'stroke 200 mm')),
        ('gx4_c351s_l', ('reach 350 mm', 'J2 -165 … 120°')),
        ('c3_a601s', ('reach 600 mm', 'J3 -51 … 225°')),
    ],
)
def test_text_has_reach_and_ranges_of_the_manual(
    name: str, words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import matplotlib as mpl

    monkeypatch.setitem(mpl.rcParams, 'svg.fonttype', 'none')
    path = tmp_path / 'picture.svg'
    draw_envelope(path, load_robot_model(name))
    text = path.read_text('utf-8')
    assert all(word in text for word in words)


def test_arm_of_another_kind_is_refused(tmp_path: Path) -> None:
    model = dataclasses.replace(load_robot_model('gx8_c552s'), joint_types=('revolute',) * 4)
    with pytest.raises(PictureError, match='this kind of arm cannot be plotted'):
        draw_envelope(tmp_path / 'picture.png', model)
