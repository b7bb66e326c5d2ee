"""Wrong inputs for the command `sumo-mcts`, made on the spot, and the judge of its answers.

`make attack` runs all of them.
"""
