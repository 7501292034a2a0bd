# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Run a command in a separate terminal. SIGUSR1 closes it, like a lost ssh connection.

Ends with the command's exit code.
"""

import os
import pty
import signal
import sys

if __name__ == '__main__':
    child, terminal = pty.fork()
    if not child:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)  # nohup ignores it
        os.execvp(sys.argv[1], sys.argv[1:])
    signal.signal(signal.SIGUSR1, lambda *_: os.close(terminal))
    try:
        while os.read(terminal, 4096):
            pass
    except OSError:
        sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
