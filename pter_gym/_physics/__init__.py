"""The world without goals: clutches, arm, friction, and the one substep in which they meet."""
