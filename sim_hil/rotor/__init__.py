"""The machine: rigid rotor on a fluid film and a coupling, pedestal and motor on their bolts."""
