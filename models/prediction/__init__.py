"""The predictor: episodes, what the brain says of them, intervals that cover what they say."""
