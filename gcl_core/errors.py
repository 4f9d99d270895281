"""The one error this project raises for bad input."""


class GclError(ValueError):
    """Bad input, named together with its remedy.

    The command line turns it into exit code 2, the node into a log line; neither dies from it.
    """
