"""One engine for rules that relate English and programs, its rule files, and the normal form of texts."""
