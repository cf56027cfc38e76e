"""The trajectory observation: short windows of the motion, fitted to the channels of a run."""
