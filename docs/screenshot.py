"""Takes the README's picture: the real supervisor over the real demo, as SVG.

    python docs/screenshot.py [FILE.svg]

It starts the demo's processes in a realm of their own, puts two virtual robots on the arm, lets the lever be
closed, and photographs the screen meanwhile.
"""

from __future__ import annotations

import asyncio
import re
import sys
from pathlib import Path

from robotree.tui.demo import cast
from robotree.tui.processes.crew import Crew
from robotree.tui.processes.realm import joined
from robotree.tui.screen.app import Supervisor

HERE = Path(__file__).parent
EXAMPLES = HERE.parent / "examples"
REALM = "demo"
SIZE = (120, 26)
SETTLED = 2.5
"""[s] until the tree is drawn and the arm is on its way."""
WEB_FONTS = re.compile(r"@font-face \{.*?\}\s*", re.DOTALL)
"""Fonts from elsewhere: the picture must be whole without a network."""


async def shoot(path: Path) -> None:
    """Play the scene and write the picture."""
    async with Crew(REALM) as crew:
        await cast(crew)
        async with joined(REALM) as fleet:
            await fleet.create(str(EXAMPLES / "move_square.py"), "square")
            await fleet.create(str(EXAMPLES / "move_to.py"), "mover")
            await fleet.create(str(EXAMPLES / "open_close_lever.py"), "lever")
            await fleet.enslave("square", "rover", "rover-1")
            await fleet.enslave("mover", "arm", "arm-1")
            await fleet.enslave("lever", "mover", "mover")
            app = Supervisor(fleet, realm=REALM)
            async with app.run_test(size=SIZE) as pilot:
                closing = asyncio.create_task(fleet.call("lever", "close", {}, deadline=60))
                await pilot.press("t")
                await pilot.pause(SETTLED)
                picture = WEB_FONTS.sub("", app.export_screenshot(title="robotree"))
                await asyncio.to_thread(path.write_text, picture, encoding="utf-8")
                await closing


if __name__ == "__main__":
    asyncio.run(shoot(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "supervisor.svg"))
