# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What is wrong between this machine and a controller, and what to do (docs/troubleshooting.md).

environment.py looks at this machine; listening.py at what a controller sends, state_facts.py finds
its habits in that; asking.py asks what cannot move anything; learning.py makes a profile of it.
"""
