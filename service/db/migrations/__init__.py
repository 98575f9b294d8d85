"""One tree of revisions for SQLite and PostgreSQL; revision 0007 makes schema version 7.

What a revision needs to know of its tables is written in it, since the models go on changing.
"""
