"""The film surrogate: truth, networks, rivals, bars."""
