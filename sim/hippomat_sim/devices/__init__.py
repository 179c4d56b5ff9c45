"""The three devices of a simulated robot, behind pseudo-terminals, speaking the vendors' protocols."""
