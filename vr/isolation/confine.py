"""The limits that the kernel keeps for a robot in a process of its own.

*Resource limits* (setrlimit(2)): memory, descriptors, size of a file, no core dump. *Landlock* (landlock(7)):
it reads what Python and libraries need, and writes in its own folder only. *seccomp* (seccomp(2)): it starts
no process, opens no socket, sends no signal to others, traces nobody, mounts nothing, and changes no owner,
mode, time or attribute of a file, for which Landlock knows no right. All three hold for each thread and
cannot be taken back. A kernel without Landlock leaves that part out, and `confine` says so.

Constants are those of Linux's headers `linux/landlock.h`, `linux/seccomp.h`, `linux/bpf_common.h`,
`linux/prctl.h`, and the system call tables of x86_64 and of the generic table (aarch64, riscv64).
"""

from __future__ import annotations

import ctypes
import os
import platform
import resource
import signal
import struct
import sys
import sysconfig
from collections.abc import Sequence
from pathlib import Path
from typing import Final

MEMORY: Final = 1024 * 1024 * 1024
"""[bytes] of address space that a robot may take beyond what it has at its start."""
DESCRIPTORS: Final = 256
LARGEST_FILE: Final = 256 * 1024 * 1024
"""[bytes]"""

# linux/prctl.h
_PR_SET_PDEATHSIG, _PR_SET_SECCOMP, _PR_SET_NO_NEW_PRIVS = 1, 22, 38
_SECCOMP_MODE_FILTER = 2
# linux/landlock.h
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_PATH_BENEATH = 1
_EXECUTE, _WRITE_FILE, _READ_FILE, _READ_DIR = 1, 2, 4, 8
_READS = _READ_FILE | _READ_DIR
_OF_FILES = _EXECUTE | _WRITE_FILE | _READ_FILE | 1 << 14 | 1 << 15  # truncate, ioctl on devices
_RIGHTS_BY_ABI = {1: (1 << 13) - 1, 2: (1 << 14) - 1, 3: (1 << 15) - 1, 4: (1 << 15) - 1, 5: (1 << 16) - 1}
_SCOPED = 3  # abstract Unix sockets, signals
_SCOPE_FROM = 6
"""The first version of Landlock that keeps signals and abstract sockets inside."""

_SYSTEM = ("ld.so.cache", "localtime", "passwd", "group", "nsswitch.conf", "ssl/openssl.cnf")
_ROOMS = ("client", "examples", "files", "front", "kinds", "protocol", "proxy", "sim", "testing", "tui", "vr")
"""Folders of the packages of robotree in its repository."""
_HARMLESS = frozenset(
    ("LANG", "LANGUAGE", "TZ", "PATH", "LD_LIBRARY_PATH", "VIRTUAL_ENV", "HOME", "TERM", "COLORTERM")
)
_HARMLESS_SORTS = ("LC_", "PYTHON", "OMP_", "OPENBLAS_", "MKL_")
"""Names of the variables that a process for code of others is given, and how such names may begin."""
_READABLE = (
    *("/usr", "/lib", "/lib64"),
    *(f"/etc/{name}" for name in _SYSTEM),
    "/dev/null",
    "/dev/zero",
    "/dev/urandom",
    "/proc/self",
)

# linux/filter.h, linux/seccomp.h, linux/audit.h
_LD, _JEQ, _JSET, _RET, _AND = 0x20, 0x15, 0x45, 0x06, 0x54
_ALLOW, _KILL, _ERRNO = 0x7FFF0000, 0x80000000, 0x00050000
_EPERM, _ENOSYS = 1, 38
_NUMBER, _ARCH, _ARG0, _ARG4 = 0, 4, 16, 48
"""[bytes] from the start of `struct seccomp_data`."""
_CLONE_THREAD = 0x00010000
_X32 = 0x40000000

_MACHINES = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
"""What the kernel calls the machines whose system calls are known (`AUDIT_ARCH_*`)."""
_CALLS: dict[str, tuple[int | None, int | None]] = {
    "socket": (41, 198),
    "connect": (42, 203),
    "bind": (49, 200),
    "listen": (50, 201),
    "fork": (57, None),
    "vfork": (58, None),
    "execve": (59, 221),
    "ptrace": (101, 117),
    "mount": (165, 40),
    "umount2": (166, 39),
    "keyctl": (250, 219),
    "unshare": (272, 97),
    "perf_event_open": (298, 241),
    "open_by_handle_at": (304, 265),
    "setns": (308, 268),
    "process_vm_readv": (310, 270),
    "process_vm_writev": (311, 271),
    "bpf": (321, 280),
    "execveat": (322, 281),
    "userfaultfd": (323, 282),
    "io_uring_setup": (425, 425),
    "pidfd_send_signal": (424, 424),
    "pidfd_open": (434, 434),
    "pidfd_getfd": (438, 438),
    "tkill": (200, 130),
    "prlimit64": (302, 261),
    "kill": (62, 129),
    "tgkill": (234, 131),
    "clone": (56, 220),
    "memfd_create": (319, 279),
    "shmget": (29, 194),
    "msgget": (68, 186),
    "semget": (64, 190),
    "shmat": (30, 196),
    "shmctl": (31, 195),
    "semop": (65, 193),
    "semctl": (66, 191),
    "semtimedop": (220, 192),
    "msgsnd": (69, 189),
    "msgrcv": (70, 188),
    "msgctl": (71, 187),
    "inotify_init": (253, None),
    "inotify_init1": (294, 26),
    "inotify_add_watch": (254, 27),
    "fanotify_init": (300, 262),
    "fanotify_mark": (301, 263),
    "add_key": (248, 217),
    "request_key": (249, 218),
    "mq_open": (240, 180),
    "mq_unlink": (241, 181),
    "sethostname": (170, 161),
    "setdomainname": (171, 162),
    "setuid": (105, 146),
    "setgid": (106, 144),
    "setreuid": (113, 145),
    "setregid": (114, 143),
    "setgroups": (116, 159),
    "setresuid": (117, 147),
    "setresgid": (119, 149),
    "setfsuid": (122, 151),
    "setfsgid": (123, 152),
    "chroot": (161, 51),
    "pivot_root": (155, 41),
    "settimeofday": (164, 170),
    "clock_settime": (227, 112),
    "adjtimex": (159, 171),
    "clock_adjtime": (305, 266),
    "kcmp": (312, 272),
    "reboot": (169, 142),
    "swapon": (167, 224),
    "rt_sigqueueinfo": (129, 138),
    "rt_tgsigqueueinfo": (297, 240),
    "sched_setparam": (142, 118),
    "sched_setscheduler": (144, 119),
    "sched_setaffinity": (203, 122),
    "sched_setattr": (314, 274),
    "setpriority": (141, 140),
    "ioprio_set": (251, 30),
    "fchmodat": (268, 53),
    "fchmodat2": (452, 452),
    "fchownat": (260, 54),
    "setxattr": (188, 5),
    "lsetxattr": (189, 6),
    "removexattr": (197, 14),
    "lremovexattr": (198, 15),
    "chmod": (90, None),
    "chown": (92, None),
    "lchown": (94, None),
    "fchmod": (91, 52),
    "fchown": (93, 55),
    "fsetxattr": (190, 7),
    "fremovexattr": (199, 16),
    "setxattrat": (463, 463),
    "removexattrat": (466, 466),
    "file_setattr": (469, 469),
    "utime": (132, None),
    "utimes": (235, None),
    "futimesat": (261, None),
    "utimensat": (280, 88),
    "ioctl": (16, 29),
    "prctl": (157, 167),
    "fcntl": (72, 25),
    "socketpair": (53, 199),
    "sendto": (44, 206),
    "sendmsg": (46, 211),
    "sendmmsg": (307, 269),
    "clone3": (435, 435),
}
"""Numbers of system calls, on x86_64 and in the generic table; None: it is not there."""

_OF_OTHERS = (0x40086602, 0x40046602, 0x401C5820, 0x5412, 0x541C)
"""FS_IOC_SETFLAGS, FS_IOC_FSSETXATTR, TIOCSTI, TIOCLINUX: for them a descriptor that only reads is enough."""

_BY_ARGUMENT: tuple[tuple[str, int, int, tuple[int, ...], bool], ...] = (
    ("prctl", 16, 0xFFFFFFFF, (_PR_SET_PDEATHSIG,), False),  # it ends with its host, whatever it does
    ("fcntl", 24, 0xFFFFFFFF, (8, 10, 15), False),  # F_SETOWN, F_SETSIG, F_SETOWN_EX: signals to others
    ("ioctl", 24, 0xFFFFFFFF, _OF_OTHERS, False),  # attributes of files; keys typed at a terminal
    ("socketpair", 24, 0xF, (1,), True),  # SOCK_STREAM: others can be sent to by name
    ("sendto", _ARG4, 0xFFFFFFFF, (0,), True),  # no address
)
"""Calls that are refused (False), or allowed alone (True), for values of an argument: its place [bytes] in
`struct seccomp_data`, which bits of it count, and the values."""

_OF_ITSELF = ("kill", "tgkill", "prlimit64")
"""Calls that name a process first; allowed for this one."""


def end_with_parent(parent: int) -> None:
    """Have the kernel end this process when its parent ends (prctl(2), PR_SET_PDEATHSIG).

    Args:
        parent: number of the process that has made this one; if it has gone already, this one ends now.
    """
    _libc().prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        os._exit(0)


def confine(writable: Sequence[str]) -> list[str]:
    """Set all limits for this process, for good. Only one thread may run.

    Args:
        writable: folders in which it may write.

    Returns:
        What this kernel does not limit, as clauses; empty: it limits all.

    Raises:
        OSError: a limit that this kernel has could not be set.
    """
    _limit_resources()
    libc = _libc()
    lacks: list[str] = []
    _check(libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0), "no_new_privs")
    if not _landlock(libc, writable):
        lacks.append("it reads all that this user may: the kernel has no Landlock")
    if not _seccomp(libc):
        lacks.append(f"it may start processes: no filter is known for {platform.machine()}")
    return lacks


def _limit_resources() -> None:
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    for limit, value in (
        (resource.RLIMIT_AS, size + MEMORY),
        (resource.RLIMIT_NOFILE, DESCRIPTORS),
        (resource.RLIMIT_FSIZE, LARGEST_FILE),
        (resource.RLIMIT_CORE, 0),
    ):
        _, most = resource.getrlimit(limit)
        wanted = value if most == resource.RLIM_INFINITY else min(value, most)
        resource.setrlimit(limit, (wanted, wanted))


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _check(code: int, what: str) -> int:
    if code < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"{what}: {os.strerror(number)}")
    return code


def needed() -> set[str]:
    """Return the paths that Python, its libraries and robotree need to read."""
    paths = {sys.prefix, sys.base_prefix, sys.exec_prefix, *packages()}
    paths |= {path for path in sys.path if path}
    paths |= {sysconfig.get_paths()[name] for name in ("stdlib", "platstdlib", "purelib", "platlib")}
    return paths


def packages() -> set[str]:
    """Return the folders of robotree's packages; in a checkout these alone, without what lies beside them."""
    root = Path(__file__).resolve().parents[2]
    if (root / "__init__.py").is_file():
        return {str(root)}
    return {str(root / room) for room in _ROOMS if (root / room).is_dir()}


def environment() -> dict[str, str]:
    """Return what a process for code of others gets of our environment: nothing that could be a secret."""
    given = os.environ.items()
    return {name: value for name, value in given if name in _HARMLESS or name.startswith(_HARMLESS_SORTS)}


def _landlock(libc: ctypes.CDLL, writable: Sequence[str]) -> bool:
    """Limit which files are read and written; returns whether the kernel can do that."""
    version = libc.syscall(_CREATE_RULESET, None, ctypes.c_size_t(0), 1)
    if version < 1:
        return False
    rights = _RIGHTS_BY_ABI[min(version, max(_RIGHTS_BY_ABI))]
    scoped = _SCOPED if version >= _SCOPE_FROM else 0
    asked = struct.pack("<QQQ", rights, 0, scoped)[: 24 if version >= _SCOPE_FROM else 8]
    rules = _check(libc.syscall(_CREATE_RULESET, asked, ctypes.c_size_t(len(asked)), 0), "Landlock")
    try:
        for path in {*_READABLE, *needed()}:
            _allow(libc, rules, path, _READS)
        for path in writable:
            _allow(libc, rules, path, rights & ~_EXECUTE)
        _allow(libc, rules, "/dev/null", rights & (_READ_FILE | _WRITE_FILE))
        _check(libc.syscall(_RESTRICT_SELF, rules, 0), "Landlock")
    finally:
        os.close(rules)
    return True


def _allow(libc: ctypes.CDLL, rules: int, path: str, rights: int) -> None:
    try:
        place = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return  # nothing is there, so there is nothing to allow
    try:
        if not os.path.isdir(path):  # noqa: PTH112 # it may be part of a zip file
            rights &= _OF_FILES
        rule = struct.pack("<Qi", rights, place)
        _check(libc.syscall(_ADD_RULE, rules, _PATH_BENEATH, rule, 0), f"Landlock for {path}")
    finally:
        os.close(place)


def _seccomp(libc: ctypes.CDLL) -> bool:
    """Filter system calls; returns whether their numbers are known for this machine."""
    machine = platform.machine()
    if machine not in _MACHINES:
        return False
    program = filter_for(machine, own=os.getpid())
    instructions = ctypes.create_string_buffer(program, len(program))
    head = struct.pack("@HP", len(program) // 8, ctypes.addressof(instructions))
    _check(libc.prctl(_PR_SET_SECCOMP, _SECCOMP_MODE_FILTER, head, 0, 0), "seccomp")
    return True


def _by_argument(
    number: int, offset: int, mask: int, values: Sequence[int], *, allowed: bool
) -> list[tuple[int, int, int, int]]:
    """Return the part of the filter that decides on a call by one of its arguments."""
    hit, miss = (_ALLOW, _ERRNO | _EPERM) if allowed else (_ERRNO | _EPERM, _ALLOW)
    tests = [(_JEQ, len(values) - place, 0, value) for place, value in enumerate(values)]
    body = [(_LD, 0, 0, offset), (_AND, 0, 0, mask), *tests, (_RET, 0, 0, miss), (_RET, 0, 0, hit)]
    return [(_JEQ, 0, len(body), number), *body]


def filter_for(machine: str, own: int) -> bytes:
    """Return the filter as a program of the kernel's packet filter (bpf(4), seccomp(2)). Pure.

    Args:
        machine: its name, one of `_MACHINES`.
        own: number of the process that is limited.
    """
    column = [*_MACHINES].index(machine)
    calls = {name: number for name, row in _CALLS.items() if (number := row[column]) is not None}
    code: list[tuple[int, int, int, int]] = [
        (_LD, 0, 0, _ARCH),
        (_JEQ, 1, 0, _MACHINES[machine]),
        (_RET, 0, 0, _KILL),
        (_LD, 0, 0, _NUMBER),
        (_JSET, 0, 1, _X32),
        (_RET, 0, 0, _ERRNO | _ENOSYS),
    ]
    # the C library makes threads by clone(2), whose flags can be seen, where clone3(2) is unknown
    code += [(_JEQ, 0, 1, calls["clone3"]), (_RET, 0, 0, _ERRNO | _ENOSYS)]
    code += [
        (_JEQ, 0, 4, calls["clone"]),
        (_LD, 0, 0, _ARG0),
        (_JSET, 0, 1, _CLONE_THREAD),
        (_RET, 0, 0, _ALLOW),
        (_RET, 0, 0, _ERRNO | _EPERM),
    ]
    for name in _OF_ITSELF:
        code += [
            (_JEQ, 0, 5, calls[name]),
            (_LD, 0, 0, _ARG0),
            (_JEQ, 1, 0, own),
            (_JEQ, 0, 1, 0 if name == "prlimit64" else own),
            (_RET, 0, 0, _ALLOW),
            (_RET, 0, 0, _ERRNO | _EPERM),
        ]
    # of an address of 64 bits the upper half is looked at first; then the number is loaded again
    code += [(_JEQ, 0, 4, calls["sendto"]), (_LD, 0, 0, _ARG4 + 4), (_JEQ, 1, 0, 0)]
    code += [(_RET, 0, 0, _ERRNO | _EPERM), (_LD, 0, 0, _NUMBER)]
    for name, offset, mask, values, allowed in _BY_ARGUMENT:
        code += _by_argument(calls[name], offset, mask, values, allowed=allowed)
    known = {"clone", "clone3", *_OF_ITSELF, *(name for name, *_ in _BY_ARGUMENT)}
    for name, number in calls.items():
        if name not in known:
            code += [(_JEQ, 0, 1, number), (_RET, 0, 0, _ERRNO | _EPERM)]
    code.append((_RET, 0, 0, _ALLOW))
    return b"".join(struct.pack("<HBBI", *each) for each in code)
