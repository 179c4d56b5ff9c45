"""hippomat-replay: reproduce recorded runs, say how far, and name the first divergence.

Decides what is printed and the exit code: 0 reproduced, 1 tool or usage error, 2 diverged, 3 damaged.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence

from hippomat_core.errors import HippomatError
from hippomat_logs.clip_command import clip, cut_window
from hippomat_logs.closed_loop import command as closed_loop
from hippomat_logs.golden_command import update_golden
from hippomat_logs.reader import open_runs
from hippomat_logs.recovery import unfinished
from hippomat_logs.replay_arguments import check, parser, replay_options
from hippomat_logs.replay_pool import replay_all
from hippomat_logs.replay_show import say_error, show
from hippomat_logs.report import TOOL_ERROR, overall_exit_code
from hippomat_logs.serve import serve
from hippomat_logs.terminal import Terminal


def main(arguments: Sequence[str] | None = None) -> int:
    options = parser().parse_args(arguments)
    console = Terminal()
    try:
        check(options)
        if options.update_golden:
            accepted = (options.reason, options.allow_dirty, options.json)
            return update_golden(options.logs, *accepted, console)
        if options.clip and options.at is not None:
            return cut_window(options.logs, options.clip, options.at, console)
        for line in unfinished(options.logs):
            Terminal(stderr=True).print(f"note: {line}", style="yellow", markup=False)
        runs = open_runs(options.logs)
        if options.serve:
            return serve(runs, console, options.speed, options.step)
        if options.clip:
            return clip(runs, options.clip, options.json, console)
        if closed_loop.asked(options):
            return closed_loop.run(runs, options, console)
        reports = replay_all(runs, replay_options(options))
    except HippomatError as error:
        say_error(error, options.json)
        return error.exit_code
    except KeyboardInterrupt:
        print("hippomat-replay: interrupted", file=sys.stderr)
        return TOOL_ERROR
    except BrokenPipeError:
        raise
    except OSError as error:
        print(f"hippomat-replay: {error}", file=sys.stderr)
        return TOOL_ERROR
    if options.json:
        print(json.dumps([report.as_json() for report in reports], indent=2, default=str))
    else:
        show(reports, console)
    return overall_exit_code(reports)


if __name__ == "__main__":
    sys.exit(main())
