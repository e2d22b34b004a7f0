"""Pages of authors: begun, composed, checked, and made into bundles."""

from __future__ import annotations

from functools import partial

from robotree.tui.line.action import ANYWHERE, AUTHOR, Action, Where

shell = partial(Action, group=AUTHOR, where=Where.SHELL)

VERBS = (
    shell(
        "new [NAME] [--over KIND | --from PAGE]",
        "Write a page NAME.py, its test and settings for an editor into this folder, on top of a KIND"
        " of robotree.kinds: arm, rover, limb, head, base and others; or begin with a PAGE of an installed"
        " package, or a file. Nothing is overwritten. Without NAME: list the pages that packages offer.",
        start="authoring:new",
        examples=("new", "new team --over arm", "new night --from patrol"),
    ),
    Action(
        "compose [NAME] [--from FILE] [--of ROBOT] [--tolerance LENGTH] [--untried] [--force]",
        "Make a virtual robot without writing code: a page NAME.py, its panel and its test. FILE: what"
        " was shown once and recorded (`record`, FILE.mcap; --of: what these robots did, `arm-1,arm-2`, else"
        " what persons asked), a FILE.session, or steps as text. Ways are simplified within LENGTH (10 mm)."
        " It is tried in a twin of the cell before anything is written, unless --untried; nothing is"
        " overwritten without --force. Without FILE: the page of the full screen, where one chooses steps or"
        " shows them by hand.",
        group=AUTHOR,
        where=ANYWHERE,
        run="recording.composed:compose",
        start="supervising:compose",
        key="C",
        label="Compose",
        alters=True,
        examples=("compose", "compose cup --from cup.mcap", "compose cup --from cup.steps --force"),
        guide=("robotree.tui.composing.lines",),
    ),
    shell(
        "check FILE",
        "Check a page and its panels without any robot: what it would lose, what blocks, what its"
        " children lack.",
        start="authoring:check",
        examples=("check team.py", "check team.py --json"),
    ),
    shell(
        "bundle build FILE [--out OUT] [--key KEY] [--may LIST]",
        "Make a bundle of a page, FILE.py or FILE.py:Class, or of a script: one file, signed, which can"
        " be mailed. --key: your private key of OpenSSH; else that of the realm, or ~/.ssh/id_ed25519."
        " --may: the commands that it may call, KIND.COMMAND,…; else what the page says or shows.",
        start="bundles:build",
        needs=("machines",),
        examples=(
            "bundle build team.py",
            "bundle build team.py --may Arm.move,Rover.* --key ~/.ssh/id_ed25519",
        ),
    ),
    shell(
        "bundle verify FILE [--trust FILE] [--requirements POLICY] [--allow-packages LIST]",
        "Check a bundle as a host of yours would: is it as it was signed, and would it run?",
        start="bundles:verify",
        needs=("machines",),
        examples=("bundle verify team.bundle",),
    ),
    shell(
        "bundle sign FILE [--out OUT] [--key KEY]",
        "Sign a bundle anew: you answer for it from then on, and not who has signed it before.",
        start="bundles:sign_anew",
        needs=("machines",),
        examples=("bundle sign team.bundle --out ours.bundle",),
    ),
    shell(
        "bundle trust [KEY …] [--name WHO] [--may LIST] [--isolation LEVEL] [--authority] [--replace]"
        " [--revoke] [--trust FILE]",
        "Let hosts of yours run what the owner of a KEY has signed; a KEY is `ssh-ed25519 AAAA…`, its"
        " file, or a bundle. --may: what it may call at most, KIND.COMMAND,…. --isolation: how it runs at"
        " least: none, process, sandbox. --authority: the key is that of a realm, and its members whose"
        " names fit WHO are meant, such as *@plant. --replace: the key has another line already, which goes."
        " --revoke: end that for ever. Without KEY: list them.",
        start="bundles:trust",
        alters=True,
        needs=("machines",),
        examples=(
            "bundle trust",
            "bundle trust anna.pub --name anna --may Arm.*,Rover.move",
            "bundle trust team.bundle --revoke",
        ),
        guide=("robotree.vr.bundle.trust",),
    ),
    shell(
        "bundle show FILE",
        "Print what a bundle says of itself: its signer, what it needs, and what it may do.",
        start="bundles:show",
        needs=("machines",),
        examples=("bundle show team.bundle", "bundle show team.bundle --json"),
    ),
)
