# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motions of the tool as joint trajectories: lines, arcs, blends, and sequences of motions."""
