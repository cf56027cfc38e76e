"""Plan of a campaign: which effects a set of sensors would detect, before anything is recorded."""
