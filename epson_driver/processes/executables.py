# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Names and descriptions of the executables."""

EXECUTABLES = {
    'client': 'the ROS 2 node: joint states, robot status, FollowJointTrajectory',
    'sim_controller': 'a simulated EPSON controller',
    'demo': 'both of them, and a planned trajectory executed, with a report',
    'fleet': 'many simulated robots with their drivers, and how they do',
    'panel': 'the robots in a browser: 3D, lamps, curves, log and buttons',
    'smooth': 'make a planned trajectory smooth: a file, a report and a picture',
    'smooth_goals': 'the same for goals, in front of any driver: FollowJointTrajectory in and out',
    'exercise': 'your own program against the simulated controller, once per fault',
    'doctor': 'what is wrong from this machine to the controller, and what to do',
    'first-run': 'the first day with a real robot, step by step, into one file',
    'report': 'what happened in a run, from a trace or a bag, as one HTML page',
    'robots': 'list the robot models, with their numbers and where those come from',
    'spel': 'check and test EPSON programs (SPEL+) without a robot',
    'pendant': 'do what a person does at the controller: motors, E-stop, reset, status',
}
