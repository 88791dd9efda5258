"""Floor 9: the work of every command, one file a command: from a frozen Request to a reviewed result; no terminal.

A task is a module with

* `Request`: a frozen keyword-only dataclass, whose fields are the command's options (`tasks/options/`) and whose
  docstring is the command's help;
* `EXAMPLE`: the same from Python, one line;
* `run(request, listener=SILENT) -> Outcome`: read, calibrate, review; told through a Listener;
* `reads(request)`, where it reads files by name: those that no output may replace.

`registry.py` names it. The command line, the verbs of `calibrant` and the web page are made from these.
"""
