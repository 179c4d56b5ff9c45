"""Allocators behind one port (port.py), the observation x_i and quantised costs. No maps, no radio."""
