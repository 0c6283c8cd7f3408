"""The same calls for asyncio: several at once, and streams that are iterated."""

import asyncio

from handrail import aio
from handrail.messages import RobotState


async def main() -> None:
    async with aio.connect() as robot:
        info, status, library = await asyncio.gather(robot.robot(), robot.status(), robot.library())
        print(f"{info.name}, {status.clock} clock, {len(library.entries)} things in its library")

        async with robot.events(RobotState) as states:
            count = 0
            async for state in states:
                count += 1
                if count == 3:
                    print(f"three states, the last at {state.time_ns / 1e9:.3f} s")
                    break


asyncio.run(main())
