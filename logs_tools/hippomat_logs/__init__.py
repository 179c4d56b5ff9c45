"""The run log: recorder, recovery, reader, replay and metrics (MCAP, ROS 2 profile)."""
