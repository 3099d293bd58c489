"""Write the generated parts of the reference pages anew."""

from docs.generate.pages import FOLDER, refreshed

for path in sorted(FOLDER.glob("*.md")):
    text = path.read_text(encoding="utf-8")
    renewed = refreshed(text)
    if renewed != text:
        path.write_text(renewed, encoding="utf-8")
        print(f"{path.name} has changed")
