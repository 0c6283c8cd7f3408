pragma Singleton
import QtQuick
import Handrail

// The words for the models' codes, in one place for translators. An unknown code is shown as it is rather than hidden.
QtObject {
    // A step of the tour: what to do, how, and on which page.
    function tour(step) {
        return ({
            connect: { title: qsTr("Start a simulated robot"), text: qsTr("In a terminal: handrail up talos_upper --scene valve --clock wall. This window finds it by itself, and shows it in half a minute.") },
            look: { title: qsTr("Look around"), text: qsTr("Drag in the 3-D view to turn it, two fingers or the wheel to move and zoom. The buttons above it bring you back. The small points are what the robot's camera sees: a red wheel stands before it.") },
            enable: { title: qsTr("Enable the drives"), text: qsTr("Enable stands above, beside STOP. The robot holds still until a program, or you, move it.") },
            place: { title: qsTr("Place a wheel"), text: qsTr("Objects has the templates: what the robot can work on. Touch Wheel: it appears in the view, and is where you say that the valve is."), page: "objects" },
            drag: { title: qsTr("Drag it onto the valve"), text: qsTr("Its arrows and rings move and turn it. Lay it over the wheel that the camera sees. Its waypoints turn green where the arm reaches them, and red where it does not."), page: "objects" },
            run: { title: qsTr("Run a program on it"), text: qsTr("Library, Turn a valve: choose an arm, then Run. It plans first; nothing moves yet."), page: "library" },
            approve: { title: qsTr("Look at the ghost, then approve"), text: qsTr("The blue robot shows the first stroke; drag the bar below it to see it move. The card above says how near it comes to anything.") },
            watch: { title: qsTr("Watch it turn"), text: qsTr("The states light up one after the other. Pause stops the motion where it is, Resume goes on from there."), page: "task" },
            stop: { title: qsTr("Press STOP once"), text: qsTr("Always the same corner, Escape, Space or F12: the robot stops, whatever it does, and stays stopped until it is cleared.") },
            over: { title: qsTr("That is all that it takes"), text: qsTr("Clear the stop and enable the drives to go on. Canvas and Code change what the robot does, Move moves it by hand, Record keeps what happened. The tour is under Robot, whenever you want it.") },
        })[step] || { title: "", text: "" }
    }

    function link(state) {
        return ({
            waiting: qsTr("Waiting for a robot"),
            attached: qsTr("Connected"),
            lost: qsTr("Connection lost"),
        })[state] || state
    }

    function drives(state) {
        return ({
            unknown: qsTr("Drives unknown"),
            stopped: qsTr("Stopped"),
            fault: qsTr("Drive fault"),
            quick_stop: qsTr("Quick stop"),
            enabled: qsTr("Drives enabled"),
            disabled: qsTr("Drives not enabled"),
        })[state] || state
    }

    function drivesColor(state) {
        return ({
            unknown: Theme.faint, stopped: Theme.danger, fault: Theme.danger, quick_stop: Theme.danger,
            enabled: Theme.good, disabled: Theme.warning,
        })[state] || Theme.faint
    }

    // Why a control can't be used; shown on the control itself.
    function why(code) {
        return ({
            "": "",
            no_robot: qsTr("no robot"),
            observer: qsTr("you only observe"),
            replaying: qsTr("a replay is shown"),
            is_recording: qsTr("is being recorded"),
            not_recording: qsTr("nothing is recorded"),
            no_engine: qsTr("the engine does not answer"),
            no_program: qsTr("no program"),
            stopped: qsTr("stop is latched"),
            not_stopped: qsTr("not stopped"),
            already_enabled: qsTr("already enabled"),
            not_enabled: qsTr("drives not enabled"),
            already_paused: qsTr("is paused"),
            nothing_failed: qsTr("nothing failed"),
            not_paused: qsTr("not paused"),
            not_running: qsTr("not running"),
            run_over: qsTr("run is over"),
            run_under_way: qsTr("is under way"),
            no_state: qsTr("no state at work"),
            plan_missing: qsTr("waiting for the plan"),
            stale: qsTr("plan is stale"),
            stale_executed: qsTr("was executed already"),
            stale_not_yet: qsTr("the plan before it is due"),
            stale_instance_removed: qsTr("template is gone"),
            stale_instance_moved: qsTr("template was moved"),
            stale_instance_parameters: qsTr("template was changed"),
            stale_instance_changed: qsTr("template was placed anew"),
            stale_start_left: qsTr("robot is not at its start"),
            stale_others_moved: qsTr("another joint has moved"),
            stale_base_moved: qsTr("robot's base has moved"),
            stale_base_unknown: qsTr("robot's place not known"),
            program_runs: qsTr("a program runs"),
            is_asked: qsTr("answer the question"),
            planning: qsTr("is being planned …"),
            nothing_to_plan: qsTr("move a slider, or show the target"),
            beyond_reach: qsTr("out of reach"),
            at_limit: qsTr("joint at its limit"),
            nothing_selected: qsTr("tap a template"),
            nothing_done: qsTr("nothing to undo"),
            nothing_undone: qsTr("nothing undone"),
            no_trajectory: qsTr("has no trajectory"),
            no_program_chosen: qsTr("choose a program"),
            loading: qsTr("is being fetched"),
            unbound: qsTr("say what with"),
            nothing_fits: qsTr("place what it needs first"),
            bad_parameter: qsTr("a parameter is out of bounds"),
            others_command: qsTr("somebody else commands"),
            sending: qsTr("sending …"),
            builtin: qsTr("comes with Handrail"),
            nothing_changed: qsTr("nothing changed"),
            nothing_to_save: qsTr("nothing to save"),
            saved_by_others: qsTr("saved by others"),
            unsound: qsTr("has an error"),
            no_name: qsTr("letters, digits, _"),
            name_taken: qsTr("is taken"),
        })[code] ?? (code.startsWith("stale_") ? qsTr("plan is stale") : code)
    }

    // The name of a plan's figure, and the colour of how it stands.
    // What holds while a target is dragged, as a choice's button has it, and as a screen reader says it.
    function kept(code, aim) {
        return ({
            torso: qsTr("Torso helps"),
            legs: qsTr("Legs help"),
            hands: aim === "mass" ? qsTr("Hands stay") : qsTr("Other hand stays"),
            gaze: qsTr("Camera looks there"),
            steady: qsTr("Tool stays turned"),
            feet: qsTr("feet that stay, and balance"),
        })[code] || code
    }
    function keptMore(code) {
        return ({
            torso: qsTr("The torso may move along"),
            legs: qsTr("The legs may move along; the feet stay"),
            hands: qsTr("Hands that are not dragged stay where they are"),
            gaze: qsTr("The head turns so that its camera looks at the target"),
            steady: qsTr("The tool stays turned as it is, all the way"),
        })[code] || code
    }
    function figure(code) {
        return ({
            clearance: qsTr("Clearance"), residual: qsTr("Off its goal"), limit_margin: qsTr("Limit margin"),
            torque_share: qsTr("Torque"), force_limit: qsTr("Force limit"),
        })[code] || Words.name(code)
    }

    function levelColor(level) {
        return ({ good: Theme.good, warning: Theme.warning, danger: Theme.danger })[level] || Theme.text
    }

    // What a figure is about, short: two bodies or a joint, where, on the way to which waypoint.
    function about(figure) {
        const what = (figure.about || "").replace(/_(link|joint)\b/g, "").replace(" and ", " – ")
        const where = figure.where ? qsTr("to %1").arg(Words.name(figure.where)) : ""
        return [where, Words.name(what)].filter(text => text).join(": ")
    }

    function run(status) {
        return ({
            none: qsTr("No program"),
            ready: qsTr("Ready"),
            running: qsTr("Running"),
            paused: qsTr("Paused"),
            succeeded: qsTr("Succeeded"),
            failed: qsTr("Failed"),
            stopped: qsTr("Stopped"),
        })[status] || status
    }

    function runColor(status) {
        return ({
            ready: Theme.muted, running: Theme.accent, paused: Theme.warning, succeeded: Theme.good,
            failed: Theme.danger, stopped: Theme.warning,
        })[status] || Theme.faint
    }

    // What to do next, where the run does not go on by itself.
    function advice(code) {
        return ({
            "": "",
            clear_first: qsTr("Next: find out why it was stopped, clear the stop, enable the drives, then repeat the state or run it again."),
            enable_first: qsTr("Next: enable the drives, then repeat the state that failed or run the program again."),
            failed: qsTr("Next: see to the cause, then repeat the state that failed, tap a state to run from there, or run it again."),
            failed_at_once: qsTr("Next: see to the cause, then run it again."),
            failing: qsTr("Next: see to the cause or move the arm out by hand, then try again; tap an earlier state to plan anew from there; skip it; or let it fail, as the program says."),
            stopped: qsTr("Next: run it again, or tap a state to run from there."),
            paused: qsTr("Next: Resume goes on where it stopped; Step goes on to the next thing it does."),
            paused_before: qsTr("Next: Resume lets it go on; Step does only what comes next; Skip leaves it out."),
        })[code] ?? code
    }

    // What a key may (docs/deployment.md).
    function role(code) {
        return ({ operator: qsTr("operator"), developer: qsTr("developer"), engine: qsTr("engine"), observer: qsTr("observer") })[code] || code
    }

    function quality(code) {
        return ({ good: qsTr("Good"), slow: qsTr("Slow"), bad: qsTr("Bad"), unknown: qsTr("Not known yet") })[code] || code
    }

    function qualityColor(code) {
        return ({ good: Theme.good, slow: Theme.warning, bad: Theme.danger })[code] || Theme.faint
    }

    // What the link carries.
    function traffic(code) {
        return ({
            robot: qsTr("Robot's state"), camera: qsTr("Camera"), engine: qsTr("Programs, plans, objects"),
            output: qsTr("Logs and outputs"), answers: qsTr("Answers"),
        })[code] || code
    }

    function milliseconds(ms) {
        return ms < 10 ? qsTr("under 10 ms") : ms < 1000 ? qsTr("%1 ms").arg(Math.round(ms / 10) * 10) : qsTr("%1 s").arg((ms / 1000).toFixed(1))
    }

    function rate(kb) {
        return kb < 10 ? qsTr("%1 KB/s").arg(kb.toFixed(1)) : kb < 1000 ? qsTr("%1 KB/s").arg(Math.round(kb)) : qsTr("%1 MB/s").arg((kb / 1000).toFixed(1))
    }

    function processState(code) {
        return ({
            up: qsTr("up"), starting: qsTr("starting"), waiting: qsTr("waits for others"), "back-off": qsTr("died, starts anew soon"),
            gone: qsTr("is gone"),
        })[code] || code
    }

    // What starting a process anew means for the robot.
    function restarting(kind) {
        return ({
            plant: qsTr("The simulated world begins anew, and the control loop with it: the robot is where it began, and not enabled."),
            loop: qsTr("The drives get no commands for some seconds: they stop by themselves and hold softly. What moves ends, and nothing moves until the robot is enabled anew."),
            server: qsTr("The motion goes on; for some seconds nobody hears of the robot and no call reaches it, STOP excepted."),
            engine: qsTr("The motion that this engine commands ends, and its program with it. Plans are forgotten; objects stay."),
            link: qsTr("Every window loses the robot for some seconds, and STOP from windows with it. The motion goes on."),
            camera: qsTr("What the camera sees stands still for some seconds. The motion goes on."),
            recorder: qsTr("The recording ends here; what follows goes into another file. The motion goes on."),
        })[kind] || kind
    }

    // Whether what an engine has or runs is what another has, or what its library has in force.
    function match(code) {
        return ({
            same: qsTr("as on the other engines"), differs: qsTr("not as on the other engines"), only: "",
        })[code] ?? code
    }

    // What the robot would do if this window lost the link.
    function ifLost(code) {
        return ({
            no_robot: qsTr("Nobody is connected."),
            nothing_moves: qsTr("Nothing moves now, and nothing would."),
            program_goes_on: qsTr("The program would go on by itself, up to its next question, which would wait for an answer. “handrail stop” on the robot's computer stops it."),
            program_waits: qsTr("The program is paused and would stay so; the robot holds."),
            motion_ends: qsTr("The motion would go on to its end; then the robot holds."),
            holds: qsTr("The robot would go on holding where it is."),
        })[code] || code
    }

    // Whether an arm can get to a waypoint.
    function reach(state) {
        return ({ reached: qsTr("within reach"), near: qsTr("near a limit"), not: qsTr("out of reach") })[state] || qsTr("not known")
    }

    // The same with the limit that it is near, or what is missed, by how much, and which joint or bodies that is about.
    function reachedHow(state, constraint, about, size) {
        const what = ({
            "joint limits": qsTr("joint limits"), clearance: qsTr("clearance"), position: qsTr("position"),
            direction: qsTr("direction"), balance: qsTr("balance"),
        })[constraint] || constraint
        const whose = about ? qsTr("%1 (%2)").arg(what).arg(about) : what
        return !constraint ? reach(state)
            : state === "near" ? qsTr("near: %1, %2 left").arg(whose).arg(size)
            : state === "not" ? qsTr("not reached: %1 missed by %2").arg(whose).arg(size)
            : reach(state)
    }

    function reachColor(state) {
        return ({ reached: Theme.good, near: Theme.warning, not: Theme.danger })[state] || Theme.faint
    }

    // How a state of the program stands.
    function mark(code) {
        return ({ active: qsTr("runs"), waiting: qsTr("waits"), failed: qsTr("failed"), passed: qsTr("done") })[code] || qsTr("not reached")
    }

    // A moment or a length of time, as 1:05.
    function minutes(seconds) {
        return Math.floor(seconds / 60) + ":" + String(Math.floor(seconds % 60)).padStart(2, "0")
    }

    function lasted(seconds) {
        return seconds >= 100 ? qsTr("%1 s").arg(Math.round(seconds))
            : Number.isInteger(seconds) ? qsTr("%1 s").arg(seconds) : qsTr("%1 s").arg(seconds.toFixed(1))
    }

    function option(name) {
        return ({
            approve: qsTr("Approve"), reject: qsTr("Reject"), yes: qsTr("Yes"), no: qsTr("No"), ok: qsTr("OK"),
            retry: qsTr("Try again"), cancel: qsTr("Cancel"), skip: qsTr("Skip"),
        })[name] || (name.charAt(0).toUpperCase() + name.slice(1)).replace(/_/g, " ")
    }

    function name(identifier) {
        return identifier.replace(/_/g, " ")
    }

    function clock(mode, seconds) {
        if (mode !== "lockstep")
            return mode ? qsTr("Wall clock") : ""
        const minutes = Math.floor(seconds / 60)
        const text = minutes + ":" + String(seconds % 60).padStart(2, "0")
        return qsTr("Simulated time %1").arg(text)
    }

    function outcome(name) {
        return ({
            done: qsTr("done"), cancelled: qsTr("cancelled"), stopped: qsTr("stopped"),
            owner_lost: qsTr("its owner is gone"), refused_by_limits: qsTr("refused by the limits"),
            drive_fault: qsTr("drive fault"), diverged: qsTr("did not follow its command"),
            stale_state: qsTr("a joint was not measured"),
        })[name] || Words.name(name)
    }

    // What a joint's signal measures.
    function quantity(code) {
        return ({
            position: qsTr("Position"), velocity: qsTr("Velocity"), torque: qsTr("Torque"), command: qsTr("Command"),
            error: qsTr("Error"),
        })[code] || code
    }

    function signalName(id) {
        const at = id.lastIndexOf("."), owner = id.slice(0, at), what = id.slice(at + 1)
        if (id.startsWith("node:")) return qsTr("Node %1, %2").arg(owner.slice(5)).arg(what)
        return owner === "force" ? qsTr("Force at the tool, %1").arg(what)
                                 : qsTr("%1, %2").arg(owner).arg(Words.quantity(what).toLowerCase())
    }

    function signals(code, text) {
        return ({
            "": "",
            too_many_signals: qsTr("Four are as many as can be told apart: take one away first."),
            no_signal: qsTr("This robot has no such signal."),
            saved: qsTr("Saved to %1").arg(text),
            not_saved: qsTr("Not saved: %1").arg(text),
        })[code] || code
    }

    // One line of the journal.
    function entry(code, a) {
        const x = a[0] || "", y = a[1] || ""
        switch (code) {
        case "log": return y ? y + ": " + x : x
        case "attached": return qsTr("Connected to %1").arg(x)
        case "detached": return qsTr("Connection lost: %1").arg(x)
        case "engine_attached": return qsTr("The engine answers")
        case "engine_detached": return qsTr("The engine does not answer: %1").arg(x)
        case "drives_enabled": return qsTr("Drives enabled")
        case "drives_disabled": return qsTr("Drives not enabled")
        case "drives_stopped": return x ? qsTr("Stopped: %1").arg(x) : qsTr("Stopped")
        case "drives_fault": return qsTr("Drive fault: %1").arg(x)
        case "drives_quick_stop": return qsTr("Drives stopped by themselves: their command stream was silent")
        case "stop_sending": return qsTr("STOP sent")
        case "stop_answered": return qsTr("STOP confirmed by the robot")
        case "stop_failed": return qsTr("STOP not confirmed: %1").arg(x)
        case "role": return qsTr("The robot knows this window as %1: %2").arg(x).arg(Words.role(y))
        case "commander": return qsTr("%1 has the command").arg(x)
        case "no_commander": return qsTr("Whoever is connected may command")
        case "left": return qsTr("%1 stays: %2").arg(x).arg(y)
        case "overwrote": return qsTr("%1: your value replaced a newer one by %2").arg(x).arg(y)
        case "template_saved": return qsTr("Saved as the template %1, in %2").arg(Words.name(x)).arg(y)
        case "refused": return qsTr("%1 refused: %2").arg(x).arg(y)
        case "unanswered": return qsTr("%1 not answered: %2").arg(x).arg(y)
        case "run_ready": return qsTr("%1 is ready").arg(Words.name(x))
        case "run_running": return qsTr("%1 runs").arg(Words.name(x))
        case "run_paused": return qsTr("%1 is paused").arg(Words.name(x))
        case "run_succeeded": return qsTr("%1 succeeded").arg(Words.name(x))
        case "run_failed": return y ? qsTr("%1 failed: %2").arg(Words.name(x)).arg(y) : qsTr("%1 failed").arg(Words.name(x))
        case "run_stopped": return y ? qsTr("%1 stopped: %2").arg(Words.name(x)).arg(y) : qsTr("%1 stopped").arg(Words.name(x))
        case "code_changed": return y ? qsTr("%1 has other code: %2 by %3").arg(x).arg(Words.name(y)).arg(a[2] || "?")
                                      : qsTr("%1 has other code").arg(x)
        case "state": return Words.name(x)
        case "prompt": return qsTr("Question: %1").arg(x)
        case "answered": return qsTr("Answered %1 by %2").arg(Words.option(x)).arg(y || "?")
        case "withdrawn": return qsTr("Question withdrawn")
        case "plan_stale": return qsTr("Plan %1 is stale: %2").arg(x).arg(y)
        case "cloud_unreadable": return qsTr("What camera %1 sees can't be shown: %2").arg(x).arg(y)
        case "action_ended": return y ? qsTr("Motion ended: %1 (%2)").arg(Words.outcome(x)).arg(y)
                                      : qsTr("Motion ended: %1").arg(Words.outcome(x))
        }
        return [code].concat(a).join(" ")
    }
}
