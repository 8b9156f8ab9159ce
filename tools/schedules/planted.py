"""Faults that are planted in a copy of umo: is each found, within how many schedules?

Each takes out a check of guardian, standby guardian, control process, reset, workers, keeper, records, locks, starter,
clients, faces, recorder or service notification, sets a wrong limit, or swaps two steps. What schedules do not see by
itself has a `layer` that covers it; both are planted then, and the two have to be found. Where there is none to be
planted, `layer` says why.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from tools.planted_faults import PlantedFault, copied, played_with
from tools.schedules.cases import ROWS

TIMEOUT = 1800.0
"""Time in s for the schedules of one fault."""
FOUND = 60
"""So many are found by themselves, at least."""


class Planted(PlantedFault):
    """A fault of the stop."""


RUN_STATE, GUARDIAN, STANDBY = "process/run_state.py", "process/guardian.py", "process/standby.py"
CONTROL, RESET, RUN_END = "process/control_process.py", "process/reset.py", "process/run_end.py"
WORKERS, WORKER, KEEPER = "process/workers.py", "process/worker.py", "process/keeper.py"
HANG, START, RECORD = "process/hang_detection.py", "process/start.py", "system/device_record.py"
PROCESSES, WATCH = "system/processes.py", "process/control_watch.py"
COMMANDED = "operation/commands/commanded.py"
COMMANDS, VERBS = "operation/commands/client_commands.py", "operation/commands/verbs.py"
CONTROL_OF_CLIENTS, QUEUE = "operation/commands/client_control.py", "process/frames/command_queue.py"
HOST, RECORDER, SERVICE = "clients/faces/host.py", "recording/recorder.py", "process/service_report.py"
PLANTED = (
    # locks and forks
    Planted("a fork is not waited for until the child holds its lock", RUN_STATE,
            "why = self._not_holding(pid, held)", 'why = ""',
            by="5:"),
    Planted("a child that is stopped before it holds its lock is waited for", RUN_STATE,
            "if now - able >= STOPPED_TIMEOUT:", "if False:",
            "the limit for one that does not begin", ["a child that does not begin is waited for"],
            by="0: stop standby at standby:2"),
    Planted("a child that does not begin is waited for", RUN_STATE,
            "if now - begun >= FORK_TIMEOUT:", "if False:",
            "the limit for one that is stopped; a child that lives begins within 1 ms",
            ["a child that is stopped before it holds its lock is waited for"]),
    Planted("a child that did not begin is left alive", RUN_STATE,
            "                self.end_process(Child(pid), END_TIMEOUT)\n", "",
            "when it goes on it finds its lock held and ends, or takes the place that is free",
            by="0 long: stop standby at standby:1; continue standby at standby:1+400ms; "
            "kill guardian at standby:1+600ms; kill control at standby:1+600ms"),
    Planted("a process that is stopped counts as able", RUN_STATE,
            "return process is not None and not (process.is_stopped or process.is_killed)",
            "return process is not None",
            by="0 long: stop guardian at worker:20; stop standby at worker:20; "
            "stop reserve at worker:20; kill worker at worker:20"),
    Planted("the end of a process is not waited for by its lock", RUN_STATE,
            "        if not self._take(who, within):\n            return False",
            "        if not self._take(who, within):\n            return True",
            by="0:"),
    Planted("a process that is to end is not killed", PROCESSES,
            "        self.send(signal.SIGKILL)\n        return wait_until", "        return wait_until",
            by=ROWS["standby follows a stopped one"]),
    Planted("a child that is stopped is not noticed", PROCESSES,
            "self.was_stopped |= bool(pid) and os.WIFSTOPPED(status)", "pass",
            "the limit of a call: who does not reset in time is killed, and the next one works",
            by="0 long: stop standby at worker:20"),
    # guardian
    Planted("the control process is not watched for silence", GUARDIAN,
            "if hung := silence.look():", 'if hung := "":',
            by=ROWS["control stopped"]),
    Planted("the guardian sends no heartbeat", GUARDIAN,
            "            self._run_state.watch()\n            self._look_around()", "            self._look_around()",
            by="0 long:"),
    Planted("the guardian does not listen", GUARDIAN,
            "0 if self._try(self._listen) else self._deaf_looks + 1", "0",
            by=ROWS["asked to stop"]),
    Planted("the end of the starter is not noticed", GUARDIAN, "if self._channel.ended:", "if False:",
            by=ROWS["starter killed"]),
    Planted("no standby guardian", GUARDIAN, "        self._standby.appoint()\n", "",
            "the next look of the guardian forks one; the reset process follows both", ["no reset process waits"],
            by=ROWS["standby follows a stopped one"]),
    Planted("no reset process waits", GUARDIAN,
            "        self._end.resetter.stand_by()\n        self._tell_reserve()\n", "",
            by=ROWS["reserve follows stopped ones"]),
    Planted("admitted before there is a standby guardian", GUARDIAN,
            "        self._standby.appoint()\n        self._run_state.admit()",
            "        self._run_state.admit()\n        self._standby.appoint()",
            "the reset process is there before; the next fault has it come later",
            by="0: hold guardian 60ms at guardian:35"),
    Planted("the reset process comes last", GUARDIAN,
            "        self._end.resetter.stand_by()\n        self._tell_reserve()\n"
            "        with suppress(Exception):\n"
            "            realtime.prepare_guardian(self._process.priority, self._process.cpu)\n"
            "        self._standby.appoint()\n        self._run_state.admit()\n",
            "        self._run_state.admit()\n        self._standby.appoint()\n        self._end.resetter.stand_by()\n"
            "        self._tell_reserve()\n",
            by="0: hold guardian 60ms at guardian:27"),
    Planted("a standby guardian that died is not replaced", GUARDIAN,
            "            self._try(self._standby.look)\n", "", "the reset process follows both",
            ["a reset process that died is not replaced"],
            by="0 long: kill standby at worker:20"),
    Planted("a reset process that died is not replaced", GUARDIAN,
            "            self._try(self._look_at_resetter)\n", "", "the standby guardian",
            ["a standby guardian that died is not replaced"],
            by="0 long: kill reserve at worker:20"),
    Planted("a worker that died is not replaced", GUARDIAN,
            "            self._try(self._workers.look)\n", "", "the reset at the end opens its device",
            ["what control could not reset is not reset"],
            by="0 long: kill worker at worker:20"),
    Planted("who takes over resets what was settled again", GUARDIAN,
            "        settled = Outcome.decode(self._run_state.settled())\n        if settled is not None:\n"
            "            self._end.tell(settled)",
            "        settled = None\n        if settled is not None:\n            self._end.tell(settled)",
            "a second reset finds all at its default; only what is told may differ"),
    Planted("who takes over asks nobody to stop", GUARDIAN,
            "            self._ask(signal.SIGTERM)  # a control process that is alive stops the machine by itself\n",
            "",
            "control stops by itself", ["control is sent nothing at the death of its guardian",
                                        "control does not look for its guardian"],
            by=ROWS["guardian killed"]),
    Planted("who takes over has the reset process of the guardian before", GUARDIAN,
            "        self._end.hand_over()\n", "", "the write to it fails, and a child is forked"),
    Planted("a stop is passed on without a signal", GUARDIAN,
            "            self._control.process.send(signal.SIGTERM)  # it ends a wait; what was asked stands in the "
            "shared memory\n", "", "control looks in each period", ["control does not look for what was asked"]),
    Planted("a claim is not given up where nothing was driven", GUARDIAN,
            "            device_claim.abandon()\n", "            pass\n",
            by="0: ask at guardian:8"),
    # hang detection
    Planted("ten times the limit of a hang", HANG, "        self._hang = hang\n", "        self._hang = 10 * hang\n",
            by=ROWS["control stopped"]),
    Planted("a third of the limit of a hang", HANG, "        self._hang = hang\n", "        self._hang = hang / 3\n",
            "three looks of 20 ms: a control process that is held up for less than 60 ms goes on"),
    Planted("a control process that has not reached every output has the time of a report", HANG,
            "return outcome is not None and not outcome.unreached", "return True",
            by="81947: stop worker at guardian:4+62ms; stop guardian at control:48; stop control at control:48"),
    Planted("a guardian is lost later", HANG, "MIN_GUARDIAN_LIMIT = 0.5", "MIN_GUARDIAN_LIMIT = 1.5",
            by=ROWS["guardian stopped"]),
    # standby guardian and reserve
    Planted("who takes over does not tell the starter who it is", STANDBY,
            '        tell_who(self._channel, "standby", os.getpid())\n        self._make_sure()\n',
            "        self._make_sure()\n",
            by="83454: ask at starter:46+77ms; stop standby at starter:46+77ms; kill guardian at standby:4"),
    Planted("a silent guardian is not seen", STANDBY,
            "        while not self._run_state.gone(LOOK_INTERVAL, Who.GUARDIAN) and self._silence.look() <= 0:",
            "        while not self._run_state.gone(LOOK_INTERVAL, Who.GUARDIAN):",
            by=ROWS["standby follows a stopped one"]),
    Planted("a standby guardian without its lock goes on", STANDBY,
            "        if not self._run_state.holds(Who.STANDBY):  # the reserve has taken this place meanwhile\n",
            "        if False:\n",
            "a child that did not begin in time is ended before another one is forked"),
    Planted("the standby guardian does not end the guardian", STANDBY,
            "        self._run_state.end_process(self._guardian, DEATH_TIMEOUT)\n", "",
            by="0 long: kill control at worker:20; hold guardian 800ms at worker:20"),
    Planted("the standby guardian does not make sure", STANDBY,
            "            pass\n        self._follow()\n", "            pass\n        self._take_over()\n",
            by="0 long: kill control at worker:20; hold guardian 800ms at worker:20"),
    Planted("the reset process does not look for silence", STANDBY,
            "if not both_dead and self._silence.look() <= RESERVE_GRACE:", "if not both_dead:",
            by=ROWS["reserve follows stopped ones"]),
    Planted("the reset process does not end the standby guardian", STANDBY,
            "if not (run_state.end(Who.STANDBY, DEATH_TIMEOUT) and run_state.hold(Who.STANDBY)):",
            "if not run_state.hold(Who.STANDBY):",
            by=ROWS["reserve follows dead ones"]),
    Planted("a standby guardian that is stopped counts as one that follows", STANDBY,
            "return process is not None and (process.is_stopped or process.is_killed)", "return False",
            by=ROWS["reserve follows dead ones"]),
    Planted("the reset process follows later", STANDBY, "RESERVE_GRACE = 1.0", "RESERVE_GRACE = 5.0",
            by=ROWS["reserve follows stopped ones"]),
    Planted("the reset process goes on when all is told", STANDBY,
            "if run_state.told or (both_dead and not run_state.admitted):", "if both_dead and not run_state.admitted:",
            "the guardian ends it",
            ["the reset process is not dismissed", "a reset process that is stopped is left behind",
             "the starter leaves behind what is stopped"], by="0:"),
    Planted("the reset process resets what was never driven", STANDBY,
            "if run_state.told or (both_dead and not run_state.admitted):", "if run_state.told:",
            "nothing was driven: a reset is needless and true"),
    # control process
    Planted("control does not wait for admission", CONTROL, "while not self._run_state.admitted:", "while False:",
            by="0: hold guardian 60ms at guardian:26"),
    Planted("control waits for a guardian that is dead", CONTROL,
            "if self._run_state.gone(ADMISSION_INTERVAL, Who.GUARDIAN) or "
            "self._run_state.unwatched > ADMISSION_TIMEOUT:",
            "if calls.sleep(0.001) or self._run_state.unwatched > ADMISSION_TIMEOUT:",
            "the limit of its heartbeats; the next fault has neither"),
    Planted("control waits for admission for ever", CONTROL,
            "            if self._run_state.gone(ADMISSION_INTERVAL, Who.GUARDIAN) or "
            "self._run_state.unwatched > ADMISSION_TIMEOUT:\n"
            "                calls.exit_now(1)\n", "            calls.sleep(0.01)\n",
            by="0: kill guardian at control:5"),
    Planted("control is sent nothing at the death of its guardian", CONTROL,
            "        calls.die_with_parent(self._guardian, signal.SIGTERM)\n", "",
            by="0 long: kill guardian at worker:20; kill standby at worker:20; kill reserve at worker:20"),
    Planted("control does not look for its guardian", CONTROL,
            "elif run_state.unwatched > self._unwatched_limit:", "elif False:",
            by=ROWS["guardian stopped"]),
    Planted("control does not look for what was asked", CONTROL,
            "        elif run_state.asked:\n", "        elif False:\n",
            "a signal comes with it", ["a stop is passed on without a signal"]),
    Planted("a lost guardian is not told", CONTROL, "        if self._guardian_lost():\n", "        if False:\n",
            by=ROWS["guardian killed"]),
    Planted("control does not retry when it is alone", CONTROL,
            "        if not (outcome.unreached and outcome.unsafe and self._run_end is not None):\n",
            "        if True:\n",
            by="0 long: kill guardian at worker:20; kill standby at worker:20; "
            "kill reserve at worker:20; kill worker at worker:20"),
    Planted("control retries beside others", CONTROL,
            "        if not (self._run_state.gone(DEATH_TIMEOUT, Who.GUARDIAN) and self._is_alone()):\n"
            "            return outcome\n", "",
            "a guardian that follows waits for the end of control, and for what it reports",
            by="0 long: kill guardian at worker:20; kill worker at worker:20"),
    Planted("control does not end a guardian that is stopped", CONTROL,
            "            guardian.send(signal.SIGKILL)\n", "            pass\n",
            by="0 long: stop guardian at worker:20; kill standby at worker:20; "
            "kill reserve at worker:20; kill worker at worker:20"),
    Planted("control says its end before it reports", CONTROL,
            "        self._run_state.report(outcome.encode())\n        self._run_state.enter(Stage.ENDED)",
            "        self._run_state.enter(Stage.ENDED)\n        self._run_state.report(outcome.encode())",
            "a report that is not whole is none: the guardian resets again"),
    # the end of a run
    Planted("control is not killed before the reset", RUN_END,
            "        control.process.send(signal.SIGKILL)\n        left", "        left",
            "the reset waits for its end, and the starter ends it", ["the starter leaves behind what is stopped"],
            by=ROWS["control stopped"]),
    Planted("what control could not reset is not reset", RUN_END,
            "        if outcome.unreached:\n            left", "        if False:\n            left",
            by=ROWS["worker killed"]),
    Planted("the reset of the guardian before is not waited for", RUN_END,
            "        self._run_state.wait(lambda: self._run_state.gone(0.0, Who.RESET), DEATH_TIMEOUT)  "
            "# the child of a dead one\n", "",
            "it dies with its guardian, whose end was waited for; another look is in `Standby._make_sure`"),
    Planted("an end that must be acknowledged is not recorded", RUN_END,
            "            if outcome.unsafe:\n", "            if False:\n",
            by=ROWS["control killed"]),
    Planted("the record of the start stays after a good end", RUN_END,
            "                self._device_claim.finish()\n", "                pass\n",
            by="0:"),
    Planted("the reset process is not dismissed", RUN_END,
            "            self.resetter.dismiss()\n", "            pass\n",
            "it sees that all is told, and is ended then",
            ["the reset process goes on when all is told", "a reset process that is stopped is left behind",
             "the starter leaves behind what is stopped"], by="0:"),
    Planted("a reset process that is stopped is left behind", RUN_END,
            "            self._end_reserve()\n", "            pass\n",
            "the starter ends it",
            ["the starter leaves behind what is stopped"],
            by="0 long: stop reserve at worker:20; kill guardian at worker:20"),
    Planted("workers are not dismissed", RUN_END,
            "            self._workers.dismiss()\n", "            pass\n",
            "a worker that is left alone brings its outputs to their defaults and ends"),
    Planted("the end is not told", RUN_END, '        self._channel.send("ended", outcome=outcome.dump())\n', "",
            by=ROWS["control killed"]),
    Planted("the next reset process never has its place", RUN_END,
            "            self._run_state.release(Who.RESERVE)\n", "            pass\n",
            "it looks for the guardians while it waits for its place",
            ["it looks for nobody while it waits for its place"]),
    # reset
    Planted("it looks for nobody while it waits for its place", RESET,
            "        while not self.takes_place(RESERVE_INTERVAL):  # one that was stopped may never begin\n"
            "            if self.in_reserve():\n                return 0\n",
            "        while not self.takes_place(RESERVE_INTERVAL):\n            pass\n",
            by="0 long: stop reserve at worker:20; kill control at worker:20; "
            "kill guardian at worker:20+200ms; kill standby at worker:20+200ms"),
    Planted("the reset process looks for nobody while it waits for work", RESET,
            "        while not calls.ready(self._waiting_pipe, RESERVE_INTERVAL):\n            if self.in_reserve():\n"
            "                return 0\n",
            "        while not calls.ready(self._waiting_pipe, RESERVE_INTERVAL):\n            pass\n",
            by=ROWS["reserve follows stopped ones"]),
    Planted("the reset process ends with the guardian", RESET,
            "            calls.sleep(RESERVE_INTERVAL)\n            while not self.in_reserve():\n"
            "                calls.sleep(RESERVE_INTERVAL)\n            return 0\n", "            return 0\n",
            by="0 long: kill guardian at worker:20; kill standby at worker:20; kill control at worker:20"),
    Planted("the reset goes on when its guardian is dead", RESET,
            "        calls.die_with_parent(guardian, signal.SIGKILL)\n", "",
            "whoever takes over waits for its end", ["the reset holds no lock"],
            by="0 long: kill control at worker:20; kill guardian at worker:20+100ms"),
    Planted("the reset holds no lock", RUN_END, "        self._run_state.hold(Who.RESET)\n", "",
            "it dies with its guardian", ["the reset goes on when its guardian is dead"],
            by="0 long: kill control at worker:20; kill guardian at worker:20+100ms"),
    Planted("no other one waits while one resets", RESET,
            "        with suppress(OSError):\n            self.stand_by(first=False)\n", "",
            "the reset that is under way is carried out; if that is killed with both guardians, nobody is left",
            by="0 long: kill control at worker:20; kill guardian at worker:20+100ms; "
            "kill standby at worker:20+100ms; kill reserve at worker:20+100ms"),
    Planted("a call that does not return is waited for", RESET,
            "silent = self._state.silence > limit\n", "silent = False\n",
            by=ROWS["resetter stopped"]),
    Planted("a limit of calls of 5 s", RESET, "CALL_MARGIN = 1.0", "CALL_MARGIN = 5.0",
            by=ROWS["resetter stopped"]),
    Planted("two seconds between two attempts", RESET, "ATTEMPT_PAUSE = 0.2", "ATTEMPT_PAUSE = 2.0",
            by=ROWS["resetter killed"]),
    Planted("nothing is done where no child can be had", RESET,
            "                self._work_here(group, is_dead, limit, until)\n", "                pass\n",
            by="0 long: no-forks guardian 60000ms at worker:20; kill reserve at worker:20; kill control at worker:20"),
    Planted("no last attempt", RESET, "        self._try_last(lasting, is_dead)\n", "",
            "the attempts before: it is for outputs that none came to, as others of their driver had timed out; here "
            "each driver has one output (tests/process/test_reset_attempts.py)"),
    Planted("the reset waits for no end of control", RESET,
            "        while not self._state.dead:\n", "        while False:\n",
            "control is killed before, and dies at once under the gate", ["control is not killed before the reset"]),
    Planted("a device whose worker is dead is not opened", RESET, "                driver.call_here_if_alone()\n", "",
            by="0 long: kill control at worker:20; kill worker at worker:20"),
    # workers
    Planted("a worker that does not answer is not ended for a retry", WORKERS,
            "            if any(id(proxy) in proxies for proxy in group.proxies):\n",
            "            if False:\n",
            by=ROWS["worker stopped"]),
    Planted("a worker that is stopped is not ended while the machine runs", WORKERS,
            "            child.send(signal.SIGKILL)\n        return \"\"", "            pass\n        return \"\"",
            "the reset at the end ends it", ["a worker that does not answer is not ended for a retry"],
            by="0 long: stop worker at worker:20"),
    Planted("a worker that is left alone does not reset", WORKER,
            "        self._reset_alone()\n        return 0\n", "        return 0\n",
            by=ROWS["all killed"]),
    Planted("a worker that is left alone tries once", WORKER,
            "            if not attempts.add(reached) and calls.now() > until:\n", "            if True:\n",
            "what is told is true: the device did not answer until then",
            by="0 long: kill guardian at worker:20; kill standby at worker:20; "
            "kill reserve at worker:20; kill control at worker:20; silent d2 150ms at worker:20"),
    Planted("a worker does not see that it is alone", WORKER,
            "        if all(run_state.gone(0.0, who) for who in (Who.GUARDIAN, Who.STANDBY, Who.RESERVE)):\n",
            "        if False:\n",
            by=ROWS["all killed"]),
    # keeper, records, starter
    Planted("a keeper that was killed is not replaced at the end", KEEPER,
            "            if not self._cells[KeeperMessage.FINISHED] and self._has_ended():\n",
            "            if False:\n",
            by="0 frames: kill keeper at keeper:9"),
    Planted("a keeper that is stopped is waited for", KEEPER,
            "        if process.is_stopped:\n            self._end()\n            return True\n", "",
            "the limit of the last values, 5 s"),
    Planted("no record of the start", RECORD,
            "                self._write(device, \"running\")\n", "                pass\n",
            by=ROWS["all killed"]),
    Planted("a stop leaves the record of a start that was not", RECORD,
            "            self.abandon()\n            if isinstance(error, OSError):\n",
            "            if isinstance(error, OSError):\n",
            "a stop waits while the devices are claimed", ["a stop comes while the devices are claimed"],
            by="0: ask at guardian:5"),
    Planted("a stop comes while the devices are claimed", GUARDIAN,
            "        calls.mask_signals(signal.SIG_BLOCK, SIGNALS)  "
            "# a stop comes before the devices are claimed or after that\n", "",
            "the record is taken back", ["a stop leaves the record of a start that was not"],
            by="0: ask at guardian:6"),
    Planted("the starter waits for whom it does not know", START,
            "        return calls.now() > self._give_up\n", "        return False\n",
            by="0: kill guardian at control:5; stop control at control:5"),
    Planted("the starter leaves behind what is stopped", START,
            "                    self._end_stopped()\n", "                    pass\n",
            by="0: kill guardian at guardian:79; stop standby at guardian:79"),
    Planted("the starter lets nobody go on", START,
            "                process.send(signal.SIGCONT)\n", "                pass\n",
            by=ROWS["all stopped"]),
    Planted("an end that nobody told counts as safe", START,
            '        Failed("Vanished", f"{text}\\n{unreached}", ExitStatus.UNREACHED), unsafe=True,',
            '        Failed("Vanished", f"{text}\\n{unreached}", ExitStatus.UNREACHED), unsafe=False,',
            by=ROWS["all killed"]),
    Planted("a guardian that was killed counts as one that ended well", START,
            "        left.unsafe = not safe\n", "        left.unsafe = False\n",
            "the record of the start stands, and the end is told as failed"),
    # clients, faces, recorder, service manager
    Planted("a worker holds the pipe that tells readers the end", GUARDIAN,
            "        self._workers.fork()  # before the frames: who holds their pipe hides the end of the run\n"
            "        if why := self._watcher.make():\n",
            "        why = self._watcher.make()\n        self._workers.fork()\n        if why:\n",
            by="0 clients: kill control at operator:12"),
    Planted("a command is carried out for who has not the lease", COMMANDS,
            "        if key != self._key:\n", "        if False:\n",
            by="0 clients:"),
    Planted("the lease is given to a second client", COMMANDS,
            "        if others and not over:\n", "        if False:\n",
            by="0 clients:"),
    Planted("a lease that nobody renews does not end", COMMANDS,
            "        return bool(self.holder) and now - self.signed > self._seconds\n", "        return False\n",
            by="0 clients: kill supervisor at supervisor:12"),
    Planted("a lease is not renewed", COMMANDS,
            "        if self.signed < then <= now:\n", "        if False:\n",
            by="0 clients:"),
    Planted("what a client holds stays when its lease ends by itself", CONTROL_OF_CLIENTS,
            "            self.end_lease(why)\n", "            self.lease.end()\n",
            by="0 clients: kill supervisor at supervisor:30"),
    Planted("what a client holds stays when another one takes its lease over", VERBS,
            '        machine.actions.drop(f"{command.who} has taken the lease over")\n', "        pass\n",
            by="0 clients: kill supervisor at supervisor:12"),
    Planted("two clients write to the queue at once", QUEUE,
            "                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)\n", "",
            by="0 clients: hold supervisor 60ms at supervisor:3"),
    Planted("a face is not told that the processes of its run are gone", HOST,
            "ended = reader.state is Stage.ENDED  # before", "ended = getattr(reader, \"is_finished\")  # before",
            by="0 clients: kill control at operator:12"),
    Planted("a recorder waits for a control process that was killed", RECORDER,
            "return self._reader.is_finished or not self._reader.alive\n", "return self._reader.is_finished\n",
            by="0 clients: kill control at operator:12"),
    Planted("the service manager is told of a life that nobody gave", SERVICE,
            "now >= self._next_alive and beat != self._beat\n", "now >= self._next_alive\n",
            by="0 clients: stop control at operator:12"),
    Planted("a heartbeat of the former holder that comes late refuses the holder", COMMANDED,
            "max(self.levels.signed(path, self.lease.number), self.lease.signed)",
            "self.levels.signed(path, self.lease.number)",
            by="0 clients: hold operator 22ms at operator:41"),
    Planted("who takes over passes on a life that was passed on", GUARDIAN,
            "        self._service.take_over()\n", "",
            by="0 clients: kill guardian at guardian:125; stop control at guardian:125"),
    Planted("the service manager is told of the start too soon", SERVICE,
            "        if stage is Stage.STARTING:\n            return\n", "        self._ready()\n",
            by="0 clients:"),
    Planted("the service manager is not told of the stop", GUARDIAN,
            '        self._try(lambda: self._service.stopping(hung or "every actuator goes to its default"))\n', "",
            by="0 clients: kill control at operator:12"),
)  # fmt: skip
BY_NAME = {each.what: each for each in PLANTED}


def measure(count: int, only: str = "") -> int:
    """Each of these faults in a copy of umo, and `count` schedules until one is wrong."""
    chosen = [each for each in PLANTED if only in each.what]
    alone = covered = 0
    with tempfile.TemporaryDirectory(prefix="umo-schedules-") as name:
        tree = copied(Path(name))
        for each in chosen:
            found = _is_found([each], tree, count)
            alone += found
            if not found and each.also:
                covered += _is_found([each, *(BY_NAME[other] for other in each.also)], tree, count)
            elif not found and each.layer:
                print(f"       covered: {each.layer}", flush=True)
    print(f"{alone} of {len(chosen)} found within {count} schedules each, {covered} with the layer that covers them")
    return int(len(chosen) == len(PLANTED) and alone < FOUND)


def _is_found(faults: Sequence[Planted], tree: Path, count: int) -> bool:
    first = [word for each in faults if each.by for word in ("--begin-with", each.by)]
    done = played_with(faults, tree, TIMEOUT, "tools.schedules", "--hunt", str(count), *first)
    said = [line for line in done.stdout.splitlines() if line.startswith("wrong: ")]
    told = said[0] if said else (done.stdout or done.stderr).strip().rpartition("\n")[2]
    is_found = bool(said) and done.returncode == 1
    if not is_found and done.returncode:
        raise RuntimeError(done.stderr[-2000:])
    which = done.stdout.strip().rpartition("\n")[2].partition(" ")[0] if is_found else count
    names = " and ".join(each.what for each in faults)
    print(f"{'found ' if is_found else 'MISSED'} {names}: {which}: {told[:200]}", flush=True)
    return is_found
