"""The command `nsdr`: one file per group of commands. Nothing imports this room."""
