# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The parts of the page that are shown and not pressed, as HTML."""

import time
from collections.abc import Sequence
from html import escape

import numpy as np

from epson_driver.motion import Array
from epson_driver.panel.lamps import Advice, Lamp
from epson_driver.panel.plots import COLOURS
from epson_driver.panel.robot_state import Event, IoRange

STALE_AFTER_S = 4
"""The browser greys what it shows if nothing new came for so long, s: by a rule of its style, so
that it does even when the panel has ended or the line is cut."""

SHOWN_EVENTS = 14

ALIVE_PATH = '/alive'
ALIVE_PERIOD_S = 0.3
"""Of the signs of life of a page that can be seen, s."""


def alive_html(window: str) -> str:
    """Return what has a page give signs of life, as the window with this secret.

    A script of the page itself: whatever freezes, hides or cuts off the page ends them.
    """
    script = (
        f"function alive(){{if(!document.hidden)fetch('{ALIVE_PATH}?{window}')"
        '.catch(function(){})}alive();clearInterval(window.edAlive);'
        f'window.edAlive=setInterval(alive,{ALIVE_PERIOD_S * 1e3:.0f})'
    )
    return f'<img alt="" src="data:," style="display:none" onerror="{script}">'


STYLE = f"""<style>
.ed{{font-size:12px;line-height:1.35;color:#212529;margin:2px 10px}}
.ed b{{font-weight:600}}
.ed-live{{animation:ed-stale 0s linear {STALE_AFTER_S}s forwards}}
@keyframes ed-stale{{to{{filter:grayscale(1) opacity(.4)}}}}
.ed-gone{{position:fixed;inset:0;z-index:100000;visibility:hidden;display:flex;align-items:center;
justify-content:center;text-align:center;padding:5vw;background:#ffffff99;
backdrop-filter:grayscale(1);animation:ed-show 0s linear {STALE_AFTER_S}s forwards}}
@keyframes ed-show{{to{{visibility:visible}}}}
.ed-gone span,.ed-alarm{{background:#c92a2a;color:#fff;border-radius:8px;padding:14px 18px;
font-size:22px;font-weight:700;line-height:1.3}}
.ed-alarm{{position:fixed;top:12px;left:50%;transform:translateX(-50%);z-index:99999;width:80vw;
max-width:720px;text-align:center;box-shadow:0 4px 24px #0006}}
*:has(>*>.ed-stop)+*,*:has(>.ed-stop)+*{{position:sticky;top:0;z-index:50;background:#fff;
padding-top:6px}}
*:has(>*>.ed-stop)+* button,*:has(>.ed-stop)+* button{{min-height:72px;font-size:26px}}
.ed-grid{{display:grid;grid-template-columns:1fr 1fr;gap:5px}}
.ed-lamp{{display:flex;align-items:center;gap:8px;background:#f4f6f8;border:1px solid #e3e7eb;
border-radius:7px;padding:4px 8px;min-width:0}}
.ed-lamp i{{flex:none;width:13px;height:13px;border-radius:50%;background:#ced4da;
box-shadow:inset 0 0 2px #0003}}
.ed-lamp span{{color:#5c6670;flex:none}}
.ed-lamp b{{margin-left:auto;text-align:right;overflow:hidden;text-overflow:ellipsis;
white-space:nowrap}}
.ed-good i{{background:#2fb344;box-shadow:0 0 6px #2fb34499}}
.ed-warn i{{background:#f59f00;box-shadow:0 0 6px #f59f0099}}
.ed-bad i{{background:#e03131;box-shadow:0 0 8px #e03131bb}}
.ed-bad{{background:#fff0f0;border-color:#ffc9c9}}
.ed-off i{{background:#868e96}}
.ed-unknown{{opacity:.62}}
.ed-advice{{border-radius:7px;padding:7px 10px;margin-top:6px;border-left:5px solid #adb5bd;
background:#f4f6f8}}
.ed-advice.ed-good{{border-color:#2fb344;background:#ebfbee}}
.ed-advice.ed-warn{{border-color:#f59f00;background:#fff9db}}
.ed-advice.ed-bad{{border-color:#e03131;background:#fff0f0}}
.ed-age{{color:#868e96;font-size:11px;margin-top:4px;display:flex;justify-content:space-between}}
.ed-joint{{display:grid;grid-template-columns:10px 58px 1fr 74px;gap:7px;align-items:center;
height:19px}}
.ed-joint i{{width:10px;height:10px;border-radius:3px}}
.ed-joint em{{font-style:normal;color:#5c6670;overflow:hidden;text-overflow:ellipsis}}
.ed-joint u{{position:relative;display:block;height:7px;border-radius:4px;background:#e9ecef}}
.ed-joint s{{position:absolute;top:-3px;width:4px;height:13px;border-radius:2px}}
.ed-joint u::after{{content:'';position:absolute;left:50%;top:0;width:1px;height:7px;
background:#adb5bd}}
.ed-joint b{{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}}
.ed-near u{{background:#ffc9c9}}
.ed-io{{display:flex;flex-wrap:wrap;gap:3px;margin:2px 0 5px}}
.ed-io span{{width:19px;height:17px;border-radius:4px;background:#e9ecef;color:#5c6670;
text-align:center;font-size:10px;line-height:17px}}
.ed-io span.on{{background:#2fb344;color:#fff}}
.ed-log{{font:11px/1.4 ui-monospace,Menlo,Consolas,monospace}}
.ed-log div{{padding-left:5.6em;text-indent:-5.6em;overflow-wrap:anywhere;
border-bottom:1px solid #f1f3f5}}
.ed-log time{{color:#adb5bd}}
.ed-log .w{{color:#b35c00}}.ed-log .e{{color:#c92a2a}}
.ed-legend{{font-weight:600;color:#495057;margin:2px 10px 0}}
</style>"""


def lamps_html(
    lamps: Sequence[Lamp], advice: Advice, ages: Sequence[tuple[str, float | None]], beat: int
) -> str:
    """Return lamps, advice and the ages of the data. `beat` makes each one another text."""
    cells = ''.join(
        f'<div class="ed-lamp ed-{lamp.colour}" data-lamp="{escape(lamp.name)}" '
        f'data-colour="{lamp.colour}" title="{escape(lamp.text)}"><i></i>'
        f'<span>{escape(lamp.name)}</span><b>{escape(lamp.text)}</b></div>'
        for lamp in lamps
    )
    remedy = f'<br>→ {escape(advice.remedy)}' if advice.remedy else ''
    shown = ''.join(f'<span>{escape(name)} {_age(age)}</span>' for name, age in ages)
    return (
        f'<div class="ed ed-live" data-beat="{beat}" data-part="lamps">'
        f'<div class="ed-grid">{cells}</div>'
        f'<div class="ed-advice ed-{advice.colour}" data-part="advice">'
        f'<b>{escape(advice.reason)}</b>{remedy}</div>'
        f'<div class="ed-age">{shown}</div></div>'
        '<div class="ed-gone" role="alert"><span>'
        f'No news from the panel for {STALE_AFTER_S} s: what is shown may be wrong, and STOP does '
        'not work. Press the E-stop.</span></div>'
    )


STOP_HTML = '<span class="ed-stop"></span>'
"""Before the button that is always in view, and large."""


def alarms_html(alarms: Sequence[str]) -> str:
    """Return what became of a STOP that was not carried out, so that nobody overlooks it."""
    if not alarms:
        return ''
    lines = '<br>'.join(escape(alarm) for alarm in alarms)
    return f'<div class="ed-alarm" role="alert" data-part="alarm">{lines}</div>'


def _age(age: float | None) -> str:
    if age is None:
        return 'none yet'
    return f'{age:.1f} s' if age < 100 else f'{age:.0f} s'


def joints_html(
    names: Sequence[str],
    positions: Array,
    low: Array,
    high: Array,
    per_unit: Array,
    units: Sequence[str],
    fresh: bool,
) -> str:
    """Return each joint as a bar between its limits, in the units shown."""
    rows = []
    for index, name in enumerate(names):
        share = (positions[index] - low[index]) / (high[index] - low[index])
        place = 100.0 * np.clip(share, 0.0, 1.0)
        near = not 0.03 < share < 0.97
        colour = COLOURS[index % len(COLOURS)] if fresh else '#adb5bd'
        value = f'{positions[index] * per_unit[index]:.1f}{units[index]}' if fresh else '?'
        limits = f'{low[index] * per_unit[index]:.0f} … {high[index] * per_unit[index]:.0f}'
        rows.append(
            f'<div class="ed-joint{" ed-near" if near else ""}" title="{escape(name)}: {limits}'
            f'{units[index]}"><i style="background:{colour}"></i><em>{escape(name)}</em>'
            f'<u><s style="background:{colour};left:calc({place:.1f}% - 2px)">'
            f'</s></u><b>{value}</b></div>'
        )
    return f'<div class="ed" data-part="joints">{"".join(rows)}</div>'


IO_NAMES = {
    1: 'Inputs',
    2: 'Outputs',
    3: 'Analog inputs [mV]',
    4: 'Analog outputs [mV]',
    5: 'Input groups',
    6: 'Output groups',
    7: 'Flags',
}
"""By the types of epson_msgs/IoPoint."""

DIGITAL = (1, 2, 7)
MAX_POINTS = 32
"""Of a type that are shown."""


def io_html(ranges: Sequence[IoRange], reason: str) -> str:
    """Return all points as small boxes, green if on, or why they are not known."""
    if reason:
        return f'<div class="ed" data-part="io">{escape(reason)}</div>'
    parts = []
    for each in ranges:
        if each.type not in IO_NAMES or not each.values or each.type in (5, 6):
            continue
        if each.type in DIGITAL:
            boxes = ''.join(
                f'<span class="{"on" if value else "off"}">{each.start + index}</span>'
                for index, value in enumerate(each.values[:MAX_POINTS])
            )
        else:
            boxes = ', '.join(str(value) for value in each.values[:MAX_POINTS])
        parts.append(f'{IO_NAMES[each.type]}<div class="ed-io">{boxes}</div>')
    return f'<div class="ed" data-part="io">{"".join(parts) or "no points"}</div>'


def log_html(events: Sequence[Event]) -> str:
    """Return the last lines of the log, the newest first."""
    lines = []
    for event in list(events)[: -SHOWN_EVENTS - 1 : -1]:
        clock = time.strftime('%H:%M:%S', time.localtime(event.at))
        kind = 'e' if event.level >= 40 else 'w' if event.level >= 30 else 'i'
        lines.append(f'<div class="{kind}"><time>{clock}</time> {escape(event.text)}</div>')
    return f'<div class="ed ed-log" data-part="log">{"".join(lines) or "nothing yet"}</div>'
