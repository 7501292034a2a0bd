# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Profiles of the supported kinds of controllers, read from config/controllers/."""

from epson_driver.profiles.profile import ControllerProfile, load_controller_profile

__all__ = ['ControllerProfile', 'load_controller_profile']
