"""Robots of a bitmap, and how a sentence names them. Knows nothing else of them."""

from __future__ import annotations


def robots_of(bitmap: int) -> list[int]:
    """Ids whose bit is set."""
    return [robot for robot in range(bitmap.bit_length()) if bitmap >> robot & 1]


def named(robots: list[int]) -> str:
    """robot 3; robots 1, 4"""
    return f"robot{'s' * (len(robots) != 1)} {', '.join(map(str, robots))}"
