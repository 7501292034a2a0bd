# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The doctor's look at this machine, as a check of `ros2 doctor` (entry point)."""

from ros2doctor.api import DoctorCheck, Result
from ros2doctor.api.format import doctor_error, doctor_warn

from epson_driver.doctor.environment import check_environment
from epson_driver.doctor.findings import Finding, Findings, Level


class EpsonDriverCheck(DoctorCheck):  # type: ignore[misc]
    """Message packages, middleware and discovery, as the driver needs them."""

    def category(self) -> str:
        """Return the name under which ros2 doctor counts it."""
        return 'epson_driver'

    def check(self) -> Result:
        """Return errors and warnings."""
        result = Result()

        def tell(finding: Finding) -> None:
            text = f'{finding.about}: {finding.found}; {finding.remedy}'
            if finding.level is Level.WRONG:
                doctor_error(text)
                result.add_error()
            elif finding.level is Level.NOTE and finding.remedy:
                doctor_warn(text)
                result.add_warning()

        check_environment(Findings(tell))
        return result
