# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Calls a std_srvs/Trigger service until it succeeds, as a separate process.

`python -m epson_driver.exercise.call_trigger SERVICE SECONDS`: exit code 0 on success, 1 after the
timeout.
"""

import sys
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger

from epson_driver.node.ros_process import udp_by_default

RETRY_S = 0.5


def main() -> int:
    name, seconds = sys.argv[1], float(sys.argv[2])
    deadline = time.monotonic() + seconds
    with udp_by_default():
        rclpy.init()
        node = rclpy.create_node('epson_driver_call')
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    client = node.create_client(Trigger, name)
    text = f'no service {name}'
    try:
        while time.monotonic() < deadline:
            if client.wait_for_service(RETRY_S):
                request = client.call_async(Trigger.Request())
                executor.spin_until_future_complete(
                    request, timeout_sec=deadline - time.monotonic()
                )
                answer = request.result() if request.done() else None
                if answer is not None and answer.success:
                    return 0
                text = answer.message if answer is not None else f'no answer from {name}'
                time.sleep(RETRY_S)
        print(text, file=sys.stderr)
        return 1
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown()


if __name__ == '__main__':
    sys.exit(main())
