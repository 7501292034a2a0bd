# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A check for `ros2 doctor` that covers this machine, loaded through an entry point."""

from ros2doctor.api import DoctorCheck, Result
from ros2doctor.api.format import doctor_error, doctor_warn

from epson_driver.doctor.environment import check_environment
from epson_driver.doctor.findings import Finding, Findings, Level


class EpsonDriverCheck(DoctorCheck):  # type: ignore[misc]
    def category(self) -> str:
        return 'epson_driver'

    def check(self) -> Result:
        result = Result()

        def add(finding: Finding) -> None:
            text = f'{finding.about}: {finding.text}; {finding.remedy}'
            if finding.level is Level.WRONG:
                doctor_error(text)
                result.add_error()
            elif finding.level is Level.NOTE and finding.remedy:
                doctor_warn(text)
                result.add_warning()

        check_environment(Findings(add))
        return result
