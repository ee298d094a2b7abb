"""The clearance policy: DDPG behind the shield, its rivals, references and judge."""
