"""The one error a user of this package should ever have to read."""


class InputError(ValueError):
    """Bad input.

    The message is one line. It names the file and the frame where there is one, what is wrong, and the mend.
    On the command line it goes to stderr and the exit status is 2.
    """
