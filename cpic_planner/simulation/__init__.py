"""Level-0 data of many sequences: what is asked for, what it costs, and the run that can be continued."""
