# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The command `report` and its page."""

import base64
import dataclasses
import hashlib
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from support.recorded_run import usual_run

from epson_driver.cli import report
from epson_driver.error_texts import load_error_texts
from epson_driver.report.figures import derivatives, figures
from epson_driver.report.page import MAX_SAMPLES, page
from epson_driver.report.run import Run
from epson_driver.report.trace_run import read_trace
from epson_driver.robots import load_robot_model


@pytest.fixture
def called(tmp_path, monkeypatch, capsys):
    """Return a function that runs the command in a folder with two traces."""
    usual_run().write(tmp_path / 'a.pcap')
    usual_run(estop=2.0).write(tmp_path / 'b.pcap')
    monkeypatch.chdir(tmp_path)

    def call(*words):
        monkeypatch.setattr(sys, 'argv', ['epson_driver report', *words])
        try:
            code = report.main()
        except SystemExit as stop:
            code = stop.code
        return code, capsys.readouterr()

    return call


def test_each_file_gets_a_page_and_json(called, tmp_path):
    code, output = called('a.pcap', 'b.pcap')
    assert code == 0
    assert 'report: b-report.html' in output.out
    figures = json.loads((tmp_path / 'a-report.json').read_text())
    assert figures['source'] == 'a.pcap'
    assert figures['motions'][0]['points'] == 3
    assert (tmp_path / 'b-report.html').read_text().startswith('<!doctype html>')
    assert [path for path in tmp_path.iterdir() if path.name.startswith('.')] == []


def test_compare_option_shows_two_runs(called, tmp_path):
    code, _ = called('--compare', 'a.pcap', 'b.pcap', '--output', 'both.html')
    assert code == 0
    both = json.loads((tmp_path / 'both.json').read_text())
    assert [item['source'] for item in both] == ['a.pcap', 'b.pcap']


def test_exported_bag_has_the_same_top_velocities_as_its_pcap(called, tmp_path):
    pytest.importorskip('rosbags')
    assert called('a.pcap', '--mcap', 'bag')[0] == 0
    assert called('bag')[0] == 0
    first = json.loads((tmp_path / 'a-report.json').read_text())
    second = json.loads((tmp_path / 'bag-report.json').read_text())
    assert second['motions'][0]['top_velocity'] == first['motions'][0]['top_velocity']


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (('--compare', 'a.pcap'), 'needs two files, not 1'),
        (('a.pcap', 'b.pcap', '--output', 'x.html'), 'need a single FILE'),
        (('a.pcap', '--output', 'x.pdf'), 'must end in .html'),
        (('nothing.pcap',), 'nothing.pcap: No such file'),
        (('a.pcap', '--robot', 'gx4_c251s', '--output', 'no/x.html'), 'No such file or directory'),
        (('a.pcap', '--robot', 'mars'), 'no robot model mars'),
        (('a.pcap', '--controller', 'mars'), 'no controller profile mars'),
        (('--compare', 'a.pcap', 'b.pcap', '--mcap', 'bag'), 'omit --compare'),
        (('a.pcap', '--address', '10.9.9.9'), 'no connection to a controller'),
    ],
)
def test_invalid_input_of_report_is_rejected_with_a_reason(called, words, message):
    code, output = called(*words)
    assert code == 2
    assert message in output.err
    assert 'Traceback' not in output.err


def test_missing_extra_is_named_with_its_command(called, monkeypatch):
    for name in [n for n in sys.modules if n.startswith(('rosbags', 'epson_driver.report.bag_'))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, 'rosbags', None)
    code, output = called('a.pcap', '--mcap', 'bag')
    assert code == 2
    assert "pip install 'epson_driver[report]'" in output.err


def test_unwritable_page_leaves_no_files(called, tmp_path):
    (tmp_path / 'there.html').mkdir()
    code, output = called('a.pcap', '--output', 'there.html')
    assert code == 2
    assert 'there.html' in output.err
    assert {path.name for path in tmp_path.iterdir()} == {'a.pcap', 'b.pcap', 'there.html'}


def test_bag_of_another_arm_is_refused(called):
    pytest.importorskip('rosbags')
    assert called('a.pcap', '--mcap', 'bag')[0] == 0
    code, output = called('bag', '--robot', 'gx4_c251s')
    assert code == 2
    assert (
        'bag: 6 joints, but the robot gx4_c251s has 4: select its model with --robot' in output.err
    )


MODEL = load_robot_model('c3_a601s')

ROOT = Path(__file__).parents[2]

ASSETS = ROOT / 'epson_driver/pages/assets'


def made(tmp_path, **options):
    path = usual_run(**options).write(tmp_path / 'run.pcap')
    run = read_trace(path, MODEL.limits, load_error_texts())
    return run, page([(run, figures(run))], MODEL)


def data_of(text):
    return json.loads(re.search(r'<script id="data"[^>]*>(.*?)</script>', text, re.DOTALL)[1])


def test_policy_allows_only_scripts_and_styles_of_the_page(tmp_path):
    _, text = made(tmp_path)
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)[1]
    rules = dict(rule.strip().split(' ', 1) for rule in policy.split(';'))
    assert rules['default-src'] == "'none'"
    assert set(rules) == {'default-src', 'script-src', 'style-src', 'base-uri', 'form-action'}
    for kind, pattern in (
        ('script-src', r'<script>(.*?)</script>'),
        ('style-src', r'<style>(.*?)</style>'),
    ):
        hashes = {
            "'sha256-" + base64.b64encode(hashlib.sha256(item.encode()).digest()).decode() + "'"
            for item in re.findall(pattern, text, re.DOTALL)
        }
        assert hashes == set(rules[kind].split())
    assert text.index('Content-Security-Policy') < text.index('<style>') < text.index('<script>')
    assert not re.search(r'<(link|img|iframe|script|source)[^>]*\s(src|href)=', text)


@pytest.mark.slow
def test_page_of_a_minute_is_at_most_two_megabytes():
    count = 60 * 182
    times = np.arange(count) / 182.0
    noise = np.random.default_rng(1).normal(size=(count, 6))  # nothing to compress
    run = Run(
        'minute', 10**18, MODEL.joint_names, times, np.cumsum(noise, axis=0) * 1e-3, ended=60.0
    )
    assert len(page([(run, figures(run))], MODEL).encode()) <= 2_000_000


@pytest.mark.slow
def test_page_shows_a_subset_of_a_long_run_and_names_the_stride(tmp_path):
    count = MAX_SAMPLES * 5 // 2
    times = np.arange(count) * 0.005
    run = Run('long', 10**18, MODEL.joint_names, times, np.zeros((count, 6)), ended=187.0)
    data = data_of(page([(run, figures(run))], MODEL))
    assert data['runs'][0]['stride'] == 3
    assert len(base64.b64decode(data['runs'][0]['times'])) / 4 <= MAX_SAMPLES
    assert data['runs'][0]['figures']['joint_states']['count'] == count


def test_page_data_equal_the_run(tmp_path):
    run, text = made(tmp_path, estop=2.0)
    held = data_of(text)['runs'][0]
    positions = np.frombuffer(base64.b64decode(held['positions']), '<f4').reshape(-1, 6)
    assert np.array_equal(positions, run.positions.astype('<f4'))
    assert held['figures']['events'][-1]['text'] == run.events[-1].text
    times = [change[0] for change in held['conditions']]
    assert times == sorted(times)
    assert held['conditions'][-1][1] == list(run.conditions[-1].flags)


def test_source_name_is_escaped_in_the_page(tmp_path):
    run, _ = made(tmp_path)
    evil = dataclasses.replace(run, source='</script><script>alert(1)</script>"')
    text = page([(evil, figures(evil))], MODEL)
    assert '<script>alert' not in text
    assert data_of(text)['runs'][0]['figures']['source'] == evil.source


def test_bundle_has_licences_and_versions():
    wanted = json.loads((ROOT / 'generate/page_bundle/package.json').read_text())['dependencies']
    licences = (ASSETS / 'bundle.LICENSES.txt').read_text()
    for name, version in (('three.js', wanted['three']), ('uPlot', wanted['uplot'])):
        assert f'=== {name} {version} ===' in licences
        assert f'{name} {version}' in (ASSETS / 'bundle.js').read_text()[:200]
    assert licences.count('Permission is hereby granted') == 2


def test_derivatives_of_a_parabola_are_exact_at_uneven_times():
    times = np.cumsum(np.random.default_rng(2).uniform(0.002, 0.012, 300))
    positions = np.stack([3.0 - 2.0 * times + 5.0 * times**2, times * 0.0], axis=1)
    velocities, accelerations = derivatives(times, positions)
    assert velocities[:, 0] == pytest.approx(-2.0 + 10.0 * times, abs=1e-6)
    assert accelerations[:, 0] == pytest.approx(np.full(300, 10.0), rel=1e-5)
    assert not velocities[:, 1].any()
