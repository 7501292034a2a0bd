# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A user of a moving cell whose shared memory is lost. Runs in a private mount namespace.

Arguments: a folder, and how the memory is lost. The user's nodes have Fast DDS' own transports.
"""

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from epson_driver.processes import processes
from support.cell import LASTS, START, Cell
from support.ros_peer import Contexts, RosPeer, trajectory

NOBODY = 65534
SHARED = Path('/dev/shm')


processes.ros_environment = lambda domain: os.environ | {'ROS_DOMAIN_ID': str(domain)}


def main(folder: Path, how: str) -> None:
    cell = Cell(folder).ready()
    peers = [cell.peer]
    try:
        cell.peer.enable()
        goal = cell.peer.goal(trajectory((LASTS, [1.0, *START[1:]])))
        cell.peer.wait_for_motion()
        files = [path for path in SHARED.iterdir() if path.name.startswith('fast')]
        assert files, 'the user has no shared memory'
        if how == 'removed':
            for path in files:
                path.unlink()
        else:
            os.seteuid(NOBODY)
            peers.append(RosPeer(cell.domain, contexts=Contexts()))
            peers[-1].wait_until_ready()
        print('stop', *peers[-1].call('stop'))
        print('ended', *goal.result() if how == 'removed' else peers[-1].assert_still()[:1])
        if how == 'removed':  # a new peer
            peers.append(RosPeer(cell.domain, contexts=Contexts()))
            peers[-1].wait_until_ready()
            print('stop', *peers[-1].call('stop'))
    finally:
        os.seteuid(0)
        for peer in peers[1:]:
            peer.close()
        cell.close()


if __name__ == '__main__':
    main(Path(sys.argv[1]), sys.argv[2])
