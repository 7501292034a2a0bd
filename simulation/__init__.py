# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The whole system from one seed: real driver and controller, simulated users, network and time.

`python -m simulation --seed 7` plays one world, `--minutes 10` plays new ones for that time. A
seed is a number, or several joined by dots: `7.3` is the event list of seed 7, varied by 3.
"""
