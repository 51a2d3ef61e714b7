"""Work on texts of strangers, in a child process with limits.

The child has a limit of memory, its answers have limits of time and size, and on Linux (x86-64)
seccomp admits listed system calls only: no network, no other program, no writing of files. While a
child prepares, with other programs such as a compiler, Landlock lets it write below a private folder
only. Hostile code in the child can answer nothing but bytes, which the caller decodes as data.
"""

import ctypes
import os
import resource
import shutil
import signal
import struct
import sys
import tempfile
import warnings
import weakref
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from platform import machine
from select import poll
from time import monotonic
from typing import Final, NoReturn, TypeAlias

from rvaft.errors import ToolFailed, ToolMissing, ToolTimeout
from rvaft.support.processes import end_with_parent

Handler: TypeAlias = Callable[[bytes], bytes]
"""Answers a request with bytes; it handles its own errors."""

MEMORY: Final = 2 << 30
REPLY: Final = 4 << 20
FILE: Final = 256 << 20
_LENGTH: Final = struct.Struct("<Q")
_BLOCK: Final = 1 << 20
_STOPPING: Final = frozenset({signal.SIGINT, signal.SIGTERM})
"""The signals that end a command."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a child: bytes of memory beyond those of its parent, bytes of a reply, bytes of each
    file that it writes before it is confined, and seconds for each answer.
    """

    memory: int = MEMORY
    reply: int = REPLY
    file: int = FILE
    seconds: float = 60.0


class Child:
    """A child process that answers requests, one at a time; it ends with its parent.

    `serve` runs in the child and returns the handler of requests. It may call `confine` after a
    preparation that needs programs or files; otherwise the child is confined before. `name` names
    the child in errors. A child that failed is replaced at the next request.
    """

    def __init__(self, name: str, serve: Callable[[], Handler], limits: Limits, *, prepared: bool = False) -> None:
        self._name = name
        self._serve = serve
        self._limits = limits
        self._prepared = prepared
        self._end: weakref.finalize[..., Child] | None = None
        self._pid = self._to = self._from = -1
        self.number = 0
        """The number of processes so far: what an earlier process held is lost."""

    def ask(self, request: bytes) -> bytes:
        """Return the answer of the child, which is started where necessary.

        Raises `ToolTimeout`, and `ToolFailed` if the child ended or answered too much. The process is
        killed after every exception.
        """
        if self._end is None or not self._end.alive:
            self._start()
        try:
            return self._exchange(_LENGTH.pack(len(request)) + request)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Kill the process and remove its folder."""
        if self._end is not None:
            self._end()

    def _start(self) -> None:
        folder = tempfile.mkdtemp(prefix="rvaft-") if self._prepared else ""
        (taken, self._to), (self._from, given) = os.pipe(), os.pipe()
        sys.stdout.flush()
        sys.stderr.flush()
        signal.pthread_sigmask(signal.SIG_BLOCK, _STOPPING)  # Python drops what a signal raises while it forks
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)  # threads of libraries hold no lock used here
                pid = os.fork()
            if not pid:
                signal.pthread_sigmask(signal.SIG_UNBLOCK, _STOPPING)
                _be_child(self._serve, self._limits, folder, taken, given, confined=not self._prepared)
            os.close(taken)
            os.close(given)
            os.set_blocking(self._to, False)
            self._pid, self.number = pid, self.number + 1
            self._end = weakref.finalize(self, _ended, os.getpid(), pid, self._to, self._from, folder)
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, _STOPPING)

    def _exchange(self, sending: bytes) -> bytes:
        until = monotonic() + self._limits.seconds
        found, size, left = bytearray(), -1, memoryview(sending)
        while size < 0 or len(found) < size:
            waiting = poll()
            waiting.register(self._from, 1)  # POLLIN; the end of the child, too, is reported
            if left:
                waiting.register(self._to, 4)  # POLLOUT
            remaining = until - monotonic()
            if remaining <= 0:
                raise ToolTimeout(self._name, seconds=self._limits.seconds)
            ready = dict(waiting.poll(1000 * remaining))
            if self._to in ready and left:
                with suppress(BlockingIOError, BrokenPipeError):
                    left = left[os.write(self._to, left[:_BLOCK]) :]
            if self._from not in ready:
                continue
            data = os.read(self._from, _BLOCK)
            if not data:
                raise ToolFailed(self._name, reason=self._cause())
            found += data
            if size < 0 and len(found) >= _LENGTH.size:
                (size,) = _LENGTH.unpack_from(found)
                size += _LENGTH.size
                if size > self._limits.reply:
                    raise ToolFailed(self._name, reason=f"an answer of more than {self._limits.reply >> 20} MB")
        return bytes(found[_LENGTH.size :])

    def _cause(self) -> str:
        """Return why the child ended by itself; `close` still finds it, so that no other process has its number."""
        found = os.waitid(os.P_PID, self._pid, os.WEXITED | os.WNOWAIT)
        if found is None or found.si_code == os.CLD_EXITED:
            return f"its process ended with status {found and found.si_status}"
        known = {int(one): one.name for one in signal.Signals}
        name = known.get(found.si_status, str(found.si_status))
        return f"its process was ended by {name}; it has at most {self._limits.memory >> 20} MB of memory"


def _ended(parent: int, pid: int, to: int, from_: int, folder: str) -> None:
    """Kill a child of this process, which nobody has waited for; a fork of the parent leaves it alone."""
    if os.getpid() != parent:
        return
    for pipe in (to, from_):
        with suppress(OSError):
            os.close(pipe)
    for kill in (os.killpg, os.kill):  # the group exists once the child has made it
        with suppress(OSError):
            kill(pid, signal.SIGKILL)
    with suppress(OSError):
        os.waitpid(pid, 0)
    if folder:
        shutil.rmtree(folder, ignore_errors=True)


def _be_child(
    serve: Callable[[], Handler], limits: Limits, folder: str, taken: int, given: int, *, confined: bool
) -> NoReturn:
    """Answer requests until the parent is gone; nothing of the parent runs after it."""
    try:
        parent = os.getppid()
        os.setsid()
        end_with_parent()
        if os.getppid() != parent:
            os._exit(1)
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        nowhere = os.open(os.devnull, os.O_RDWR)
        taken, given = (os.dup(pipe) for pipe in (taken, given))  # above the standard streams, if these are closed
        kept = {taken, given}
        for stream in range(3):
            if stream not in kept:
                os.dup2(nowhere, stream)
        low = sorted(kept)
        os.closerange(3, low[0])
        os.closerange(low[0] + 1, low[1])
        os.closerange(low[1] + 1, 1 << 16)
        _limit(limits)
        if folder:
            os.environ["TMPDIR"] = tempfile.tempdir = folder
            _write_below(folder)
        if confined:
            with suppress(ToolMissing):  # what interprets a text is trusted to start nothing
                confine()
        answer: Handler | None = None
        while (head := _read(taken, _LENGTH.size)) is not None:
            request = _read(taken, *_LENGTH.unpack(head))
            if request is None:
                break
            if answer is None:
                answer = serve()
            reply = answer(request)
            sending = memoryview(_LENGTH.pack(len(reply)) + reply)
            while sending:
                sending = sending[os.write(given, sending) :]
    finally:
        os._exit(1)  # no handler of the parent runs


def _read(pipe: int, size: int) -> bytes | None:
    found = bytearray()
    while len(found) < size:
        data = os.read(pipe, min(size - len(found), _BLOCK))
        if not data:
            return None
        found += data
    return bytes(found)


def _limit(limits: Limits) -> None:
    with suppress(OSError, ValueError):
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        most = pages * resource.getpagesize() + limits.memory
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (limits.file, limits.file))


# System calls of Linux on x86-64, and what seccomp admits.

_NO_NEW_PRIVILEGES: Final = 38
_SECCOMP: Final = 22
_X86_64: Final = 0xC000003E
_LIBC: Final = ctypes.CDLL(None, use_errno=True) if sys.platform == "linux" else None
_ADMITTED: Final = {
    "files": "read 0, readv 19, pread64 17, write 1, writev 20, close 3, lseek 8, dup 32, pipe2 293, fadvise64 221",
    "names": "stat 4, lstat 6, fstat 5, newfstatat 262, statx 332, statfs 137, fstatfs 138, access 21, faccessat 269, "
    "faccessat2 439, readlink 89, readlinkat 267, getdents64 217, getcwd 79",
    "memory": "mmap 9, munmap 11, mremap 25, mprotect 10, brk 12, madvise 28, mincore 27, membarrier 324",
    "threads": "futex 202, rseq 334, set_robust_list 273, get_robust_list 274, set_tid_address 218, sched_yield 24, "
    "sched_getaffinity 204, getcpu 309, arch_prctl 158, exit 60, exit_group 231",
    "signals": "rt_sigaction 13, rt_sigprocmask 14, rt_sigreturn 15, sigaltstack 131, restart_syscall 219",
    "time": "nanosleep 35, clock_nanosleep 230, clock_gettime 228, clock_getres 229, gettimeofday 96, time 201, "
    "poll 7, ppoll 271, select 23, pselect6 270, times 100, getrusage 98",
    "process": "getpid 39, gettid 186, getppid 110, getuid 102, geteuid 107, getgid 104, getegid 108, getrandom 318, "
    "sysinfo 99, uname 63, getrlimit 97",
}
_OPEN, _OPENAT, _CLONE, _CLONE3, _FCNTL, _PRLIMIT64, _TGKILL = 2, 257, 56, 435, 72, 302, 234
_WRITING: Final = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_THREAD: Final = 0x00010000
_DESCRIPTOR_COMMANDS: Final = (0, 1, 2, 3, 1030)
"""F_DUPFD, F_GETFD, F_SETFD, F_GETFL, F_DUPFD_CLOEXEC."""
_LOAD, _EQUAL, _AT_LEAST, _ANY_BIT, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
_ALLOW, _KILL, _EPERM, _ENOSYS = 0x7FFF0000, 0x80000000, 0x00050001, 0x00050026
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_WRITE_FILE, _CHANGE_FOLDERS, _REFER, _TRUNCATE = 1 << 1, 0b1_1111_1111 << 4, 1 << 13, 1 << 14
_Instruction: TypeAlias = tuple[int, int, int, int]


def _can_filter() -> bool:
    return _LIBC is not None and machine() == "x86_64" and sys.maxsize > 1 << 32


def can_confine() -> bool:
    """Whether this machine can confine programs: by listed system calls, and before by Landlock."""
    return _can_filter() and _landlock() > 0


def _landlock() -> int:
    """Return the version of Landlock, or -1."""
    return -1 if _LIBC is None else int(_LIBC.syscall(_CREATE_RULESET, None, 0, 1))


def _write_below(folder: str) -> None:
    """Let this process, and all that it starts, write, make and remove files below a folder only.

    It cannot be undone. Raises `ToolMissing`.
    """
    absent = ToolMissing("Landlock, which confines compilers,", remedy="use Linux 5.13 or newer on x86-64")
    version = _landlock()
    if version < 1 or _LIBC is None:
        raise absent
    writing = _WRITE_FILE | _CHANGE_FOLDERS | (version > 1) * _REFER | (version > 2) * _TRUNCATE
    network = 3 if version > 3 else 0  # to bind and to connect
    rules = ctypes.create_string_buffer(struct.pack("=QQ", writing, network)[: 16 if version > 3 else 8])
    ruleset = _LIBC.syscall(_CREATE_RULESET, rules, len(rules.raw) - 1, 0)
    if ruleset < 0:
        raise absent
    for name, rights in ((folder, writing), (os.devnull, writing & (_WRITE_FILE | _TRUNCATE))):
        place = os.open(name, os.O_PATH)
        if _LIBC.syscall(_ADD_RULE, ruleset, 1, ctypes.c_char_p(struct.pack("=Qi", rights, place)), 0):
            raise absent
        os.close(place)
    if _LIBC.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0) or _LIBC.syscall(_RESTRICT_SELF, ruleset, 0):
        raise absent
    os.close(ruleset)


def confine(*, threads: bool = True) -> None:
    """Admit listed system calls only, from now on and in all threads that this process starts.

    It cannot be undone. Raises `ToolMissing` where the system has no such filter.
    """
    absent = ToolMissing("seccomp, which confines programs,", remedy="use Linux on x86-64")
    if not _can_filter() or _LIBC is None:
        raise absent
    program = b"".join(struct.pack("=HBBI", *one) for one in _filter(threads=threads))
    code = ctypes.create_string_buffer(program)
    given = struct.pack("HxxxxxxP", len(program) // 8, ctypes.addressof(code))
    if _LIBC.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0) or _LIBC.prctl(_SECCOMP, 2, ctypes.c_char_p(given), 0, 0):
        raise absent


def _filter(*, threads: bool) -> list[_Instruction]:
    """Return the program of the filter; what it does not list is not permitted."""

    def word(argument: int, *, high: bool = False) -> _Instruction:
        return _LOAD, 0, 0, 16 + 8 * argument + 4 * high

    def call(number: int, *then: _Instruction) -> Sequence[_Instruction]:
        return (_EQUAL, 0, len(then), number), *then

    allow, refuse = (_RETURN, 0, 0, _ALLOW), (_RETURN, 0, 0, _EPERM)
    count = len(_DESCRIPTOR_COMMANDS)
    commands = [(_EQUAL, count - number, 0, one) for number, one in enumerate(_DESCRIPTOR_COMMANDS)]
    admitted = [int(one.split()[1]) for group in _ADMITTED.values() for one in group.split(",")]
    return [
        (_LOAD, 0, 0, 4),
        (_EQUAL, 1, 0, _X86_64),
        (_RETURN, 0, 0, _KILL),
        (_LOAD, 0, 0, 0),
        (_AT_LEAST, 0, 1, 0x40000000),  # the calls of the ABI x32
        refuse,
        *(one for number in admitted for one in call(number, allow)),
        *call(_OPEN, word(1), (_ANY_BIT, 0, 1, _WRITING), refuse, allow),
        *call(_OPENAT, word(2), (_ANY_BIT, 0, 1, _WRITING), refuse, allow),
        *call(_CLONE, word(0), (_ANY_BIT, 1, 0, _THREAD if threads else 0), refuse, allow),
        *call(_CLONE3, (_RETURN, 0, 0, _ENOSYS)),  # its flags cannot be seen; callers then use clone
        *call(_FCNTL, word(1), *commands, refuse, allow),
        *call(_TGKILL, word(0), (_EQUAL, 1, 0, os.getpid()), refuse, allow),  # as `abort` does
        *call(_PRLIMIT64, word(2), (_EQUAL, 0, 2, 0), word(2, high=True), (_EQUAL, 1, 0, 0), refuse, allow),
        refuse,
    ]
