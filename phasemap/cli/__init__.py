"""The command line: arguments in, files and sentences out.

`commands` finds the command that was typed; the files beside it read the arguments of a command or a few, call the
function of the same name and say in `console` what is going on. What several commands are told is in `arguments`.
Nothing else imports from here.
"""

from phasemap.cli.commands import main

__all__ = ["main"]
