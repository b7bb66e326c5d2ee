"""Entry point of the command `sumo-mcts`, and of `python -m sumo_mcts`."""

import sys

from sumo_mcts.process.supervisor import silence_libraries, supervised


def _command() -> int:
    silence_libraries()
    from sumo_mcts.cli import status  # noqa: PLC0415  # takes a while: the supervisor answers signals meanwhile

    return status()


def main() -> None:
    """Run the command line in a supervised process."""
    sys.exit(supervised(_command))


if __name__ == "__main__":
    main()
