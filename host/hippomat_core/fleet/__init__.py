"""The fleet as one robot knows it, and rule F. Start reading at state.py, rounds.py and votes.py."""
