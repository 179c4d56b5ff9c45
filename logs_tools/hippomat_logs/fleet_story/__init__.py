"""What a fleet did, put together from the logs of its robots: claims, decisions, frames, conflicts.

Start reading at values.py, then reading.py (one robot), story.py (all of them), conflicts.py.
"""
