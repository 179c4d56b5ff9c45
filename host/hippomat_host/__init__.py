"""The daemon on each robot: serial ports, clock and command line around the robot core."""
