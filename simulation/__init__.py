# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The whole system from one seed: real driver and controller, played users, network and time.

`python -m simulation --seed 7` plays one world, `--minutes 10` new ones as long as that. A seed
is a number, or several joined by dots: `7.3` is the events of seed 7, varied by 3.
"""
