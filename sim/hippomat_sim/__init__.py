"""The simulated world: PyBullet, virtual serial devices, the radio medium. Never imported by the robot."""
