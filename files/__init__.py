"""Files and folders that somebody else may have prepared: opened here, and nowhere else by hand.

    opened_own(path)        an ordinary file of ours, never through a link
    expect_own(path)        whether it is one, for libraries that open files by their names
    read(path, most)        an ordinary file, whole; a FIFO, a device or an endless file is an error at once
    private_folder(path)    a folder (0700) that only its owner can enter, made or repaired
    private_file(path)      a file (0600) that only its owner can open, made or repaired
    own_folder(path)        a folder into which nobody else can put anything, made if need be
    replace(path, data)     a file that is the old one or the new one, whatever happens meanwhile
    alone(path)             one after the other, among all who ask for the same
    sync_folder(path)       the names in a folder survive a loss of power, too
    overwrite(path, data)   a file of ours, or a new one; never through a link that another user made
    database.OwnedDatabase  a SQLite file that one process owns
    named.NamedFiles        values that people name, each in a file of a folder
    forks                   what a forked child of this process must not keep open

Everything that is wrong is an `OSError`, whose `strerror` is a clause such as "it is a FIFO, not a file".
The other rooms turn it into errors of their own. This room knows none of them, and all of them may use it.
"""

from robotree.files.opening import (
    alone,
    expect_own,
    opened,
    opened_own,
    overwrite,
    own,
    read,
    replace,
    sync_folder,
    text,
)
from robotree.files.private import own_folder, private_file, private_folder, shared_folder

__all__ = [
    "alone",
    "expect_own",
    "opened",
    "opened_own",
    "overwrite",
    "own",
    "own_folder",
    "private_file",
    "private_folder",
    "read",
    "replace",
    "sync_folder",
    "text",
    "shared_folder",
]
