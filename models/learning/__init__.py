"""Learning methods of our own: Levenberg-Marquardt, scaled conjugate gradient, DDPG; they know
nothing of rotors."""
