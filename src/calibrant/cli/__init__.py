"""Floor 10: the command line, one file a command."""

from __future__ import annotations

# As `typing` has it, which takes longer to load than Ctrl-C may find nobody to answer it.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from calibrant.cancel import Token


def main() -> None:
    """Entry point of the `calibrant` command. Ctrl-C ends it with a sentence from its first moment to its last."""
    import signal
    import sys

    try:
        status = _run()
    except KeyboardInterrupt:  # while the command line itself is loaded, or while its last words are said
        sys.stderr.write("calibrant: interrupted; no result was written\n")
        status = 130
    # All is said and written: what is left is to close, which nobody has to interrupt.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    raise SystemExit(status)


def _run() -> int:
    import gc
    import os

    # Matrices of tens of columns: BLAS's own threads wait for each other longer than they work (hand-eye of 1000 pose
    # pairs takes 1.7 times as long with two of them). Larger work is divided among threads and processes of ours.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Loading makes objects that stay, 110,000 for a hand-eye: looking through them in turns of 50,000 is a
    # twentieth of a short command, in turns of 10,000 a tenth.
    gc.set_threshold(200_000, 20, 20)
    from calibrant.cancel import Token, cancellable

    token = Token()
    _heed_interrupts(token)
    with cancellable(token):
        from calibrant.cli.application import run

        return run()


def _heed_interrupts(token: Token) -> None:
    """Ctrl-C ends what runs, even where a library's callback swallows it: then by the token, at the next step."""
    import signal
    import sys

    def stop(number: int, frame: object) -> None:
        token.cancel()
        raise KeyboardInterrupt

    def unraised(said: sys.UnraisableHookArgs) -> None:
        if said.exc_type is not KeyboardInterrupt:
            sys.__unraisablehook__(said)

    # One that is ignored, as under nohup, stays ignored.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, stop)
        sys.unraisablehook = unraised
