# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The first day with a real robot: step by step, each asked for, into one file.

steps.py are the steps, ride.py moves the arm and takes the times, habits.py says what is unusual,
book.py is the file, from which the simulated controller can be made alike.
"""
