"""The command line: arguments in, files and sentences out.

`commands` finds the command that was typed, and each command has a file of its own that reads its arguments, calls
the function of the same name and says in `console` what is going on. What several commands are told is in `arguments`,
`words` and `colours`. Nothing else imports from here.
"""

from phasemap.cli.commands import main

__all__ = ["main"]
