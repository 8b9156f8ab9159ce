/* The sketch: main.c is its loop, io_board.cpp its pins. It stands alone in its folder; open it in the IDE.
 *
 * umo_main runs the controller and does not return; the loop of the sketch is not used. */
extern "C" int umo_main(void);

void setup()
{
    (void)umo_main();
}

void loop()
{
}
