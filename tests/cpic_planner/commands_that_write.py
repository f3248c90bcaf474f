"""Run commands in this process, as a shell would one after another: ``python commands_that_write.py NAME...``.

Every command writes into the working folder, what it prints too. With ``--offline`` as first argument no socket of the
internet can be connected, and every attempt is printed. The last line names the fingerprint.
"""

import contextlib
import json
import socket
import sys
from pathlib import Path

from cpic_core import fingerprint

SURVEY = {
    "universe": {"duration_days": 730, "slot_days": 60, "universes": 40, "exclusions": "none"},
    "defaults": {
        "time_budget_h": 300,
        "targets": {"names": ["alf Cen A", "eps Eri", "tau Cet"]},
        "visit": {"bands": ["F520"], "time_s": 36000},
        "revisits": {"max_visits": 4},
    },
    "strategies": [{"name": "plain"}],
}
COMMANDS = {
    "etc": "etc 'tau Cet' --band F662 --json",
    "rank": "rank --band F520 --planets 200 --out ranking.csv",
    "few": "rank --band F520 --planets 20 --v-mag-max 3.5 --out few.csv",
    "simulate": "simulate paper_example --band F520 --exposure-s 17 --em-gain 20 --frames 2 --fidelity quick --out sim",
    "bias": "simulate --kind BIAS --frames 1 --out bias",
    "check": "check bias",
    "plan": "plan --top 1 --band F662 --time-s 300 --planets 20 --realisations 1 --fidelity quick --out plan",
    "whatif": "whatif survey.yaml --images 0 --out whatif",
    "confirm": "confirm paper_example --band F662 --realisations 1 --fidelity quick --out confirm",
    "curve": "curve 'tau Cet' --band F662 --separation-arcsec 0.5 --separation-arcsec 0.7 --time 2h --visits 1 "
    "--images 12 --injections 2 --out curve",
    "instrument": "instrument show",
    "catalog": "catalog info",
    "cache": "cache info",
    "known": "known --date 2028-06-01 --limit 2",
    "visibility": "visibility 'tau Cet' --days 60",
}


def blocked(told):
    """Refuse connections of the internet, and look-ups of names, as a machine without a network does."""

    def refuse(*asked, **more):
        told.append(repr(asked[-1]))
        raise OSError(101, "Network is unreachable")

    class Socket(socket.socket):
        def _refused(self, *asked):
            return refuse(*asked) if self.family in (socket.AF_INET, socket.AF_INET6) else None

        def connect(self, address):
            self._refused(address)
            super().connect(address)

        def connect_ex(self, address):
            self._refused(address)
            return super().connect_ex(address)

        def sendto(self, *asked):
            self._refused(*asked)
            return super().sendto(*asked)

    return {"socket": Socket, "create_connection": refuse, "getaddrinfo": refuse, "gethostbyname": refuse}


def main(names):
    import shlex

    from cpic_planner.cli.main import main as cpic

    Path("survey.yaml").write_text(json.dumps(SURVEY))
    for name in names:
        with Path(f"{name}.txt").open("w") as shown, contextlib.redirect_stdout(shown):
            status = cpic(["-q", *shlex.split(COMMANDS[name])])
        if status:
            raise SystemExit(f"{name} ended with status {status}")


if __name__ == "__main__":
    asked, told = sys.argv[1:], []
    if asked[0] == "--offline":
        for attribute, what in blocked(told).items():
            setattr(socket, attribute, what)
        del asked[0]
    main(asked)
    print(*told, sep="\n", end="\n" if told else "")
    print(fingerprint())
