"""Who may move the actuator, where to and how fast: table of failsafes, arming, command."""
