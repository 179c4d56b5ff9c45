"""The commands of hippomat-logs, one file each: its options, what it prints, its exit code."""
