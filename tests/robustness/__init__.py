"""A campaign of bad inputs, made by rule from good ones: every one must end in one line that names it, and change nothing."""
