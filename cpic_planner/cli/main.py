"""``cpic``: the command-line entry point and how it fails."""

import contextlib
import logging
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any

import typer

from cpic_core import InputError, fingerprint, numeric_context, private_folder, shortened, visible
from cpic_planner.cli import catalog_command, run_commands, star_commands, upkeep_command as upkeep
from cpic_planner.cli.command import HELP_OPTIONS, Commands, add, error_line, group
from cpic_planner.cli.progress import QuietOption, VerboseOption, set_loudness, watch
from cpic_planner.schemas import QUESTIONS
from cpic_planner.version import DISTRIBUTION, PACKAGES, __version__

EXIT_HELP = """Exit status: 0 an answer, an unreachable target or a planet that is not detected included; 1 a failure,
or findings of cpic check; 2 a question that cannot be asked, with one line that says why; 3 no answer, or no detection,
with --strict; 130 interrupted; 143 terminated
(SIGTERM, as batch schedulers send it)."""
_DIAL_HELP = """One dial trades speed for accuracy. --fidelity standard (the default) draws sums of frames where that is
allowed and audits one realisation by single frames; quick is coarser and audits nothing; reference leaves nothing
out: whole frames, one by one, in every realisation. --tolerance 0.02 picks for each scene the cheapest settings that
are predicted to keep planet flux and SNR within 2 % of the reference. Results state what was left out and what that is
predicted to cost; a tier that is not good enough for a scene says so in place of an answer. --dry-run tells the
time."""

_OVERRIDES_HELP = """What if reality is worse than the model? --simulator-overrides alters the images and nothing else:
the prediction keeps the nominal instrument, and the report says by how much it was off. KEY is a dotted key of the
instrument's file (* stands for any name) or a short one: throughput, quantum_efficiency, read_noise, dark_current,
clock_charge, drift, visit_drift, walk, jitter, exozodi; and companions (on, off). VALUE is a number with a unit
(0.1nm), a factor on the present value (x0.7), a number alone where the dotted key ends in its unit or the quantity has
none, or a word. Short names always need a unit or an x: drift=x2 doubles the offset of a visit and the walk within it;
drift=0.1nm makes the offset 0.1 nm rms and scales the walk in the same ratio.

  --simulator-overrides throughput=x0.7

  --simulator-overrides read_noise=x1.5 --simulator-overrides visit_drift=x3

  --simulator-overrides companions=on

  --simulator-overrides bands.F850.qe=0.4 --simulator-overrides detector.switches.cosmic_rays=off

  --simulator-overrides reality.yaml"""
app = Commands(
    name="cpic",
    help="Compute exposure times, plan surveys and simulate images for CPI-C, the coronagraph of the 2 m CSST.",
    epilog=f"{' '.join(EXIT_HELP.split())} cpic COMMAND --help says more.",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings=HELP_OPTIONS,
)


def _version_text() -> str:
    """Return version, fingerprint, data vintage, and whether the top-level packages are this distribution's own."""
    from importlib import metadata, util

    from catalogs import snapshot_vintage

    home = Path(__file__).resolve().parents[2]
    lines = [f"{DISTRIBUTION} {__version__}", f"fingerprint: {fingerprint()}", f"star table: {snapshot_vintage()}"]
    try:
        owners = metadata.packages_distributions()
    except Exception:
        owners = {}
    for package in PACKAGES:
        spec = util.find_spec(package)
        place = Path(spec.origin).resolve().parent.parent if spec and spec.origin else None
        foreign = sorted(set(owners.get(package, ())) - {DISTRIBUTION})
        state = "ok" if place == home and not foreign else f"also claimed by {', '.join(foreign) or place}"
        lines.append(f"package {package}: owned by {DISTRIBUTION} ({state})")
    return "\n".join(lines)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(_version_text())
        raise typer.Exit


def _printable(record: logging.LogRecord) -> bool:
    """Let a message that quotes names not steer the terminal by them."""
    record.msg, record.args = visible(record.getMessage(), "\n"), None
    return True


@app.callback(invoke_without_command=True)
def root(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option("--version", "-V", callback=_version, is_eager=True, help="Show version, data vintage and owner."),
    ] = False,
    verbose: VerboseOption = 0,
    quiet: QuietOption = False,
) -> None:
    """Set the level of messages for every command."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
        return
    handler = logging.StreamHandler(sys.stderr)
    handler.addFilter(_printable)
    logging.basicConfig(level=logging.WARNING, handlers=[handler], format="%(levelname)s: %(message)s")
    set_loudness(verbose, quiet)
    if not quiet and context.invoked_subcommand != "serve":  # which has no end to wait for
        context.with_resource(watch(context.invoked_subcommand))


for _run in (
    *(run_commands.plan, star_commands.rank, star_commands.etc, star_commands.curve, star_commands.roc),
    *(star_commands.known, run_commands.confirm, run_commands.simulate, run_commands.reduce, star_commands.visibility),
    *(run_commands.whatif, run_commands.tradeoff),
):
    _more = (_DIAL_HELP, _OVERRIDES_HELP) if _run in (run_commands.plan, run_commands.confirm) else ()
    add(app, _run.__name__, _run, QUESTIONS[_run.__name__], *_more)
add(app, "serve", upkeep.serve)
add(app, "check", upkeep.check)
add(app, "compare", upkeep.compare)
instrument = group(upkeep.INSTRUMENT_HELP, show=upkeep.show, keys=upkeep.keys, diff=upkeep.diff, table=upkeep.table)
app.add_typer(instrument, name="instrument")
catalog = group(
    catalog_command.HELP, info=catalog_command.info, columns=catalog_command.columns, refresh=catalog_command.refresh
)
app.add_typer(catalog, name="catalog")
app.add_typer(group(upkeep.CACHE_HELP, info=upkeep.info, clear=upkeep.clear), name="cache")
add(app, "schema", upkeep.schema)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit status and never shows a traceback unless asked by ``-vv``."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:  # closed: what would go there is not wanted
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115 - to the end of the process
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # looking for some reads what every package offers
    try:
        Path.home()
    except RuntimeError:  # no name, no home: astropy, matplotlib and the cache ask for one
        os.environ["HOME"] = private_folder()
    try:
        with _ending_on_sigterm(), numeric_context():
            status = app(args=arguments, standalone_mode=False, prog_name="cpic")
        sys.stdout.flush()
    except SystemExit as stop:  # the option parser leaves this way when the reader of our output has gone
        return 0 if type(sys.stdout).__name__ == "PacifyFlushWrapper" else _status(stop.code)
    except InputError as error:
        return error_line(str(error), 2)
    except KeyboardInterrupt:
        return error_line(INTERRUPTED, 130)
    except BrokenPipeError:
        _drop_output()  # its reader went away: that ends the work, quietly
        return 0
    except Exception as error:
        return _failed(error, sys.argv[1:] if arguments is None else arguments)
    return _status(status)


_CONTINUES = (
    "no file is left half written, and a run with an --out continues when it is started again with the same --out"
)
INTERRUPTED = f"interrupted; {_CONTINUES}"


@contextlib.contextmanager
def _ending_on_sigterm() -> Iterator[None]:
    """End the body on the first SIGTERM as Ctrl-C does: files are put away, and a line says how to go on."""

    def end(number: int, frame: object) -> None:
        signal.signal(number, signal.SIG_DFL)  # the second one ends the process at once
        sys.exit(128 + number)

    ours = threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    if ours:
        signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        if ours:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _status(code: object) -> int:
    """Return the exit status of a code; those of signals get their explanation."""
    if code in (130, 143):
        return error_line(INTERRUPTED if code == 130 else f"terminated; {_CONTINUES}", code)
    return code if isinstance(code, int) else 0


def _failed(error: Exception, arguments: Sequence[str]) -> int:
    if type(error).__name__ == "Abort":
        return error_line("interrupted", 130)
    message = getattr(error, "format_message", None)
    if message is not None:  # what the option parser refuses
        where = getattr(getattr(error, "ctx", None), "command_path", "cpic")
        said = shortened(message()).replace("Value error, ", "")
        if (option := getattr(error, "option_name", None)) is not None and hasattr(error, "possibilities"):
            hint = suggestion(option, error.ctx.command, arguments)  # type: ignore[attr-defined]
            said = f"No such option: {option}{f' ({hint})' if hint else ''}"
        return error_line(f"{said} (see {where} --help)" if said else f"see {where} --help", 2)
    if logging.getLogger("cpic_planner").isEnabledFor(logging.DEBUG):
        raise error
    if isinstance(error, OSError) and error.strerror:
        try:
            where = f"{error.filename}: " if error.filename is not None else ""
            sys.stdout.flush()
        except OSError:
            where = "stdout: "
            _drop_output()
        return error_line(f"{where}{error.strerror}; {_CONTINUES} (cpic -vv shows where)", 1)
    return error_line(f"{type(error).__name__}: {error} (cpic -vv shows where)", 1)


def _drop_output() -> None:
    """Keep the interpreter from complaining, at its end, about output that cannot be written."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


_WORDS = {
    "--limit": "top first head rows n number count lines max",
    "--top": "limit first head n number count targets rows max",
    "--out": "o output outdir output-dir output-file save write file dir directory folder",
    "--plot": "figure fig image picture png pdf svg draw",
    "--format": "csv ecsv latex tex markdown md form style",
    "--json": "js machine-readable",
    "--score": "sort order by rank-by sort-by order-by metric",
    "--stars": "star target targets name names only",
    "--exposure-s": "exptime exp-time exposure-time texp dit integration",
    "--frames": "ndit n-frames exposures n-exposures",
    "--em-gain": "gain emgain",
    "--workers": "j jobs threads cores processes procs parallel cpus n-jobs",
    "--instrument": "telescope config camera",
    "--catalog": "table input catalogue stars-file",
    "--date": "epoch when at mjd utc",
    "--v-mag-max": "mag-limit max-mag vmax limiting-magnitude faintest",
    "--v-mag": "mag vmag magnitude v",
    "--distance-pc": "parallax dist distance",
    "--planet-radius-rjup": "radius size",
    "--semi-major-axis-au": "sma a semimajor-axis",
    "--separation-arcsec": "sep rho angle",
    "--seed": "random random-seed random-state rng",
    "--realisations": "realizations trials repeats",
    "--time": "hours duration t total-time",
    "--force": "overwrite clobber",
    "--band": "filter filters wavelength",
    "--planets": "draws samples n-planets",
}
"""Names that options have in tools of the field and elsewhere, with the options that they mean here."""


def suggestion(name: str, command: Any, arguments: Sequence[str]) -> str:
    """Return the options that an unknown one may stand for, in words; empty if none is near.

    Parameters
    ----------
    name : str
        As it was written, with its dashes.
    command : click.Command
        The command that does not have it.
    arguments : sequence of str
        What was written, with the value of the option.
    """
    from cpic_planner.queries import SHORT_KEYS

    known = [flag for param in command.params for flag in (*param.opts, *param.secondary_opts) if flag[:2] == "--"]
    word = name.strip("-").lower().replace("_", "-")
    found = [flag for flag, words in _WORDS.items() if flag in known and word in words.split()]
    if (key := word.replace("-", "_")) in SHORT_KEYS and "--set" in known:
        after = [*arguments[arguments.index(name) + 1 :], ""] if name in arguments else [""]
        given = [text.partition("=")[2] for text in arguments if text.startswith(f"{name}=")] or after
        value = given[0] if given[0] and not given[0].startswith("-") else "x2"
        found.append(f"--set {key}={value}")
    begun = [flag for flag in known if flag.startswith(f"--{word}-")]
    near = get_close_matches(word, [flag[2:] for flag in known], n=2, cutoff=0.7)
    options = list(dict.fromkeys([*found, *begun, *(f"--{flag}" for flag in near if not found)]))[:3]
    return f"did you mean {' or '.join(options)}?" if options else ""


if __name__ == "__main__":
    sys.exit(main())
